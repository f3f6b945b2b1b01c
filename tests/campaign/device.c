/* What a device does to a process, done to it through LD_PRELOAD: its clock moves, and its sensors fail or block.

   CAMPAIGN_CLOCK names a page that the test shares: four int64, in ns where they are times.
     0  the clock that counts from boot: it stands still until the test moves it
     1  what is added to the wall clock
     2  what the process sleeps until
     3  whether it sleeps
   The monotonic clock, which stands still in a suspend, is left alone.

   Beside a file that is read with pread, <file>.fault holds "ERRNO BLOCK_MS": the read blocks that long, or as long as
   .fault is there, deaf to signals as a driver is, and then fails with ERRNO unless that is 0.
   Each such read leaves a byte in <file>.tries. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/select.h>
#include <sys/types.h>
#include <time.h>
#include <unistd.h>

enum { BOOT, WALL, DUE, ASLEEP };
static volatile int64_t *page;

static int (*real_clock_gettime)(clockid_t, struct timespec *);
static int (*real_select)(int, fd_set *, fd_set *, fd_set *, struct timeval *);
static int (*real_poll)(struct pollfd *, nfds_t, int);
static int (*real_sem_timedwait)(sem_t *, const struct timespec *);
static ssize_t (*real_pread)(int, void *, size_t, off64_t);

__attribute__((constructor)) static void start(void) {
    real_clock_gettime = dlsym(RTLD_NEXT, "clock_gettime");
    real_select = dlsym(RTLD_NEXT, "select");
    real_poll = dlsym(RTLD_NEXT, "poll");
    real_sem_timedwait = dlsym(RTLD_NEXT, "sem_timedwait");
    real_pread = dlsym(RTLD_NEXT, "pread64");
    const char *path = getenv("CAMPAIGN_CLOCK");
    int file = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    if (file < 0) return;
    void *shared = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (shared != MAP_FAILED) page = shared;
}

static struct timespec timespec_of(int64_t ns) {
    struct timespec time = {ns / 1000000000, ns % 1000000000};
    return time;
}

static int64_t ns_of(const struct timespec *time) { return time->tv_sec * 1000000000LL + time->tv_nsec; }

int clock_gettime(clockid_t clock, struct timespec *time) {
    if (!real_clock_gettime) real_clock_gettime = dlsym(RTLD_NEXT, "clock_gettime");
    int status = real_clock_gettime(clock, time);
    if (!page || status) return status;
    if (clock == CLOCK_BOOTTIME) *time = timespec_of(page[BOOT]);
    if (clock == CLOCK_REALTIME) *time = timespec_of(ns_of(time) + page[WALL]);
    return 0;
}

/* A deadline on the wall clock that this file gave out is one on the kernel's again. */
int sem_timedwait(sem_t *semaphore, const struct timespec *due) {
    struct timespec mine = timespec_of(ns_of(due) - (page ? page[WALL] : 0));
    return real_sem_timedwait(semaphore, &mine);
}

static int64_t fall_asleep(int64_t for_ns) {
    int64_t due = page[BOOT] + for_ns;
    page[DUE] = due;
    __sync_synchronize();
    page[ASLEEP] = 1;
    return due;
}

int select(int count, fd_set *reading, fd_set *writing, fd_set *failing, struct timeval *wait) {
    if (!page || !wait || (wait->tv_sec == 0 && wait->tv_usec == 0))
        return real_select(count, reading, writing, failing, wait);
    fd_set none, wanted[3];
    FD_ZERO(&none);
    fd_set *given[3] = {reading, writing, failing};
    for (int i = 0; i < 3; i++) wanted[i] = given[i] ? *given[i] : none;
    int64_t since = page[BOOT], due = fall_asleep(wait->tv_sec * 1000000000LL + wait->tv_usec * 1000LL);
    for (;;) {
        int over = page[BOOT] >= due || page[BOOT] < since; /* set back, it no longer measures the wait */
        struct timeval moment = {0, over ? 0 : 500};
        for (int i = 0; i < 3; i++)
            if (given[i]) *given[i] = wanted[i];
        int ready = real_select(count, reading, writing, failing, &moment);
        if (ready || over) {
            page[ASLEEP] = 0;
            return ready;
        }
    }
}

int poll(struct pollfd *files, nfds_t count, int wait_ms) {
    if (!page || wait_ms <= 0) return real_poll(files, count, wait_ms);
    int64_t due = fall_asleep(wait_ms * 1000000LL);
    for (;;) {
        int over = page[BOOT] >= due;
        int ready = real_poll(files, count, over ? 0 : 1);
        if (ready || over) {
            page[ASLEEP] = 0;
            return ready;
        }
    }
}

static int fault_of(int file) {
    char link[64], path[PATH_MAX + 8], word[PATH_MAX + 8], order[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, PATH_MAX - 1);
    if (length <= 0) return 0;
    path[length] = 0;
    snprintf(word, sizeof word, "%.*s.tries", PATH_MAX, path);
    char *fault = strcat(path, ".fault");
    int held = open(fault, O_RDONLY | O_CLOEXEC);
    if (held < 0) return 0;
    length = read(held, order, sizeof order - 1);
    close(held);
    int number = 0;
    long block_ms = 0;
    order[length > 0 ? length : 0] = 0;
    sscanf(order, "%d %ld", &number, &block_ms);
    int tries = open(word, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    if (write(tries, "x", 1) < 0) errno = 0; /* no room to count it */
    close(tries);
    for (long passed_ms = 0; passed_ms < block_ms && access(fault, F_OK) == 0; passed_ms += 5) {
        struct timespec moment = {0, 5000000};
        while (nanosleep(&moment, &moment) && errno == EINTR) {}
    }
    return number;
}

ssize_t pread64(int file, void *content, size_t count, off64_t from) {
    int number = fault_of(file);
    if (number) {
        errno = number;
        return -1;
    }
    return real_pread(file, content, count, from);
}

ssize_t pread(int file, void *content, size_t count, off_t from) { return pread64(file, content, count, from); }
