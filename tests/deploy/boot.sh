#!/bin/sh
# Boots a systemd of the test's own: PID 1 of new namespaces, on a copy-on-write view of this machine, in a control group
# of its own. Nothing that it writes reaches the machine. Call: boot.sh FOLDER, which has `units/` for
# /etc/systemd/system and `files/` for /; it becomes /box inside. Ends, and cleans up, on SIGTERM.
set -eu

if [ "${2-}" = inside ]; then
    box=$1
    fs=$box/fs
    mkdir "$fs"
    mount -t tmpfs box "$fs"
    mkdir "$fs/upper" "$fs/work" "$fs/root"
    mount -t overlay box -o "lowerdir=/,upperdir=$fs/upper,workdir=$fs/work" "$fs/root"
    cd "$fs/root"
    mount -t proc proc proc
    mount -t sysfs -o ro sysfs sys
    mount -t tmpfs tmpfs sys/fs
    mkdir sys/fs/cgroup
    mount -t cgroup2 cgroup2 sys/fs/cgroup
    mount -t tmpfs tmpfs run
    mount -t tmpfs tmpfs tmp
    mount --rbind /dev dev
    mkdir -p box old
    mount --bind "$box" box
    # only what the test starts: none of the machine's own services, mounts and settings
    rm -rf etc/systemd/system/* usr/lib/systemd/system/*.wants lib/systemd/system/*.wants \
        usr/lib/systemd/system-generators lib/systemd/system-generators
    # what keeps services from being started in a container, and what indexes all manuals after an installation
    rm -f usr/sbin/policy-rc.d var/lib/man-db/auto-update
    cp -r box/units/. etc/systemd/system/
    cp -r box/files/. .
    pivot_root . old
    cd /
    umount -l /old
    exec env -i container=box PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
        /lib/systemd/systemd --system --unit=box.target --log-target=console --show-status=no
fi

groups=$1/groups
mkdir "$groups"
mount -t cgroup2 cgroup2 "$groups"
group=$groups/box-$$
mkdir "$group"
echo $$ >"$group/cgroup.procs"
unshare --pid --fork --kill-child --uts --ipc --cgroup --mount --propagation private "$0" "$1" inside &
inside=$!
echo $$ >"$groups/cgroup.procs"
trap 'kill -9 $inside' TERM
wait $inside || true # until the end, or the signal
wait $inside || true
for _ in 1 2 3 4 5 6 7 8 9 10; do # what runs inside has been killed, and goes
    find "$group" -depth -type d -exec rmdir {} + 2>/dev/null && break
    sleep 0.2
done
umount "$groups"
