// The ambient that ambientd estimates, as a sensor of Android: TYPE_AMBIENT_TEMPERATURE, in a library that the Sensors
// Multi-HAL loads (interface 2.1). It follows the daemon's socket, one JSON object a line, while the sensor is active.
//
// An estimate that is not trusted is null there, and the socket of a daemon that has died is closed. Neither is an event,
// nor is a line without a number: this sensor reports what the daemon publishes, or nothing.

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "V2_1/SubHal.h"

#ifndef AMBIENTD_SOCKET
#define AMBIENTD_SOCKET "/dev/ambientd/ambient.sock"
#endif

namespace {

using ::android::sp;
using ::android::hardware::hidl_handle;
using ::android::hardware::hidl_string;
using ::android::hardware::hidl_vec;
using ::android::hardware::Return;
using ::android::hardware::Void;
using ::android::hardware::sensors::V1_0::MetaDataEventType;
using ::android::hardware::sensors::V1_0::OperationMode;
using ::android::hardware::sensors::V1_0::RateLevel;
using ::android::hardware::sensors::V1_0::Result;
using ::android::hardware::sensors::V1_0::SensorFlagBits;
using ::android::hardware::sensors::V1_0::SharedMemInfo;
using ::android::hardware::sensors::V2_1::Event;
using ::android::hardware::sensors::V2_1::SensorInfo;
using ::android::hardware::sensors::V2_1::SensorType;
using ::android::hardware::sensors::V2_1::implementation::IHalProxyCallback;
using ::android::hardware::sensors::V2_1::implementation::ISensorsSubHal;

constexpr int32_t kHandle = 1;
constexpr float kRange_degC = 100.0f;
constexpr float kResolution_degC = 0.1f;  // a smaller change is no event
constexpr int32_t kMinDelay_us = 100'000;
constexpr int32_t kMaxDelay_us = 60'000'000;
constexpr int64_t kSecond_ns = 1'000'000'000;
constexpr int64_t kRetry_ns = kSecond_ns;
constexpr size_t kLongestLine = 64 * 1024;

// The clock of sensor events; it goes on while the device sleeps.
int64_t now_ns() {
    timespec now{};
    clock_gettime(CLOCK_BOOTTIME, &now);
    return now.tv_sec * kSecond_ns + now.tv_nsec;
}

// The estimate in a line, where there is one.
std::optional<float> estimate_in(const std::string& line) {
    constexpr std::string_view key = "\"ambient_degC\": ";
    const size_t at = line.find(key);
    if (at == std::string::npos) return std::nullopt;
    const char* text = line.c_str() + at + key.size();
    char* end = nullptr;
    const float value_degC = std::strtof(text, &end);
    const bool is_number = end != text && (*end == ',' || *end == '}') && std::isfinite(value_degC);
    if (!is_number || std::abs(value_degC) > kRange_degC) return std::nullopt;
    return value_degC;
}

// A connection to the daemon that never waits.
class Connection {
  public:
    ~Connection() { close(); }

    int descriptor() const { return descriptor_; }
    bool is_open() const { return descriptor_ >= 0; }

    void open() {
        sockaddr_un address{};
        static_assert(sizeof(AMBIENTD_SOCKET) <= sizeof(address.sun_path));
        address.sun_family = AF_UNIX;
        memcpy(address.sun_path, AMBIENTD_SOCKET, sizeof(AMBIENTD_SOCKET));
        descriptor_ = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
        if (is_open() && connect(descriptor_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) != 0) close();
    }

    void close() {
        if (is_open()) ::close(descriptor_);
        descriptor_ = -1;
        rest_.clear();
    }

    // The newest whole line since the last call; empty where there is none. It closes where the daemon has gone.
    std::string newest_line() {
        char bytes[4096];
        ssize_t count;
        while ((count = recv(descriptor_, bytes, sizeof(bytes), 0)) > 0) rest_.append(bytes, count);
        const bool has_gone = count == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR);
        std::string line;
        if (const size_t end = rest_.rfind('\n'); end != std::string::npos) {
            const size_t before = end == 0 ? std::string::npos : rest_.rfind('\n', end - 1);
            const size_t begin = before == std::string::npos ? 0 : before + 1;
            line = rest_.substr(begin, end - begin);
            rest_.erase(0, end + 1);
        }
        if (has_gone || rest_.size() > kLongestLine) {
            close();
            line.clear();
        }
        return line;
    }

  private:
    int descriptor_ = -1;
    std::string rest_;
};

class AmbientSubHal : public ISensorsSubHal {
  public:
    AmbientSubHal() : wake_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)), worker_([this] { follow(); }) { worker_.detach(); }

    const std::string getName() override { return "ambientd"; }

    // At each start of the sensors framework: nothing of before is left.
    Return<Result> initialize(const sp<IHalProxyCallback>& callback) override {
        {
            std::lock_guard<std::mutex> lock(mutex_);
            callback_ = callback;
            mode_ = OperationMode::NORMAL;
            is_active_ = false;
            last_degC_.reset();
        }
        wake();
        return Result::OK;
    }

    Return<void> getSensorsList_2_1(getSensorsList_2_1_cb give) override {
        SensorInfo sensor{};
        sensor.sensorHandle = kHandle;
        sensor.name = "Estimated ambient temperature";
        sensor.vendor = "ambientd";
        sensor.version = 1;
        sensor.type = SensorType::AMBIENT_TEMPERATURE;
        sensor.typeAsString = "android.sensor.ambient_temperature";
        sensor.maxRange = kRange_degC;
        sensor.resolution = kResolution_degC;
        sensor.power = 0.0f;  // it switches nothing on
        sensor.minDelay = kMinDelay_us;
        sensor.maxDelay = kMaxDelay_us;
        sensor.fifoReservedEventCount = 0;
        sensor.fifoMaxEventCount = 0;
        sensor.requiredPermission = "";
        sensor.flags = static_cast<uint32_t>(SensorFlagBits::ON_CHANGE_MODE);
        give(hidl_vec<SensorInfo>{sensor});
        return Void();
    }

    // Accepted, as the Multi-HAL refuses the mode to all where one library does; no event comes in that mode.
    Return<Result> setOperationMode(OperationMode mode) override {
        {
            std::lock_guard<std::mutex> lock(mutex_);
            mode_ = mode;
        }
        wake();
        return Result::OK;
    }

    Return<Result> activate(int32_t handle, bool enabled) override {
        if (handle != kHandle) return Result::BAD_VALUE;
        {
            std::lock_guard<std::mutex> lock(mutex_);
            if (enabled && !is_active_) last_degC_.reset();  // who asks anew is told the value at once
            is_active_ = enabled;
        }
        wake();
        return Result::OK;
    }

    Return<Result> batch(int32_t handle, int64_t period_ns, int64_t /* latency: there is no FIFO */) override {
        if (handle != kHandle) return Result::BAD_VALUE;
        {
            std::lock_guard<std::mutex> lock(mutex_);
            period_ns_ = std::clamp(period_ns, kMinDelay_us * INT64_C(1000), kMaxDelay_us * INT64_C(1000));
        }
        wake();
        return Result::OK;
    }

    Return<Result> flush(int32_t handle) override {
        std::lock_guard<std::mutex> lock(mutex_);
        if (handle != kHandle || !is_active_) return Result::BAD_VALUE;
        Event event{};
        event.sensorType = SensorType::META_DATA;
        event.u.meta.what = MetaDataEventType::META_DATA_FLUSH_COMPLETE;
        post(event);
        return Result::OK;
    }

    Return<Result> injectSensorData_2_1(const Event& /* event */) override { return Result::INVALID_OPERATION; }

    Return<void> registerDirectChannel(const SharedMemInfo& /* memory */, registerDirectChannel_cb give) override {
        give(Result::INVALID_OPERATION, -1);
        return Void();
    }

    Return<Result> unregisterDirectChannel(int32_t /* channel */) override { return Result::INVALID_OPERATION; }

    Return<void> configDirectReport(int32_t /* handle */, int32_t /* channel */, RateLevel /* rate */,
                                    configDirectReport_cb give) override {
        give(Result::INVALID_OPERATION, 0);
        return Void();
    }

    // What a bug report shows.
    Return<void> debug(const hidl_handle& file, const hidl_vec<hidl_string>& /* arguments */) override {
        const auto* handle = file.getNativeHandle();
        if (handle == nullptr || handle->numFds < 1) return Void();
        std::lock_guard<std::mutex> lock(mutex_);
        dprintf(handle->data[0], "%s: %s, %s, ", AMBIENTD_SOCKET, is_active_ ? "active" : "inactive",
                connection_.is_open() ? "connected" : "not connected");
        if (newest_degC_) {
            dprintf(handle->data[0], "%.3f degC\n", static_cast<double>(*newest_degC_));
        } else {
            dprintf(handle->data[0], "no estimate\n");
        }
        return Void();
    }

  private:
    void wake() { eventfd_write(wake_, 1); }

    // The worker: waits for the daemon's lines and for what the calls above change.
    [[noreturn]] void follow() {
        for (;;) {
            std::unique_lock<std::mutex> lock(mutex_);
            const int64_t next_ns = step();
            const int daemon = connection_.descriptor();  // poll skips what is negative
            lock.unlock();
            const int64_t wait_ms = (next_ns - now_ns()) / 1'000'000 + 1;
            pollfd watched[] = {{wake_, POLLIN, 0}, {daemon, POLLIN, 0}};
            poll(watched, 2, next_ns < 0 ? -1 : static_cast<int>(std::max<int64_t>(wait_ms, 0)));
            eventfd_t count;
            eventfd_read(wake_, &count);
        }
    }

    // Reads and reports what is due; when to come back at the latest, or -1. With the lock held, as all that follows.
    int64_t step() {
        if (!is_active_) {
            connection_.close();
            newest_degC_.reset();
            retry_at_ns_ = 0;
            return -1;
        }
        const int64_t retry_ns = read_daemon();
        const int64_t report_ns = report();
        if (retry_ns < 0 || report_ns < 0) return std::max(retry_ns, report_ns);
        return std::min(retry_ns, report_ns);
    }

    // When to connect again, or -1 where the daemon is connected.
    int64_t read_daemon() {
        if (!connection_.is_open() && now_ns() >= retry_at_ns_) {
            retry_at_ns_ = now_ns() + kRetry_ns;
            connection_.open();
        }
        if (connection_.is_open()) {
            const std::string line = connection_.newest_line();
            if (!line.empty()) newest_degC_ = estimate_in(line);
        }
        if (connection_.is_open()) return -1;
        newest_degC_.reset();
        return retry_at_ns_;
    }

    // When the change that there is may be reported, or -1 where there is none.
    int64_t report() {
        if (!newest_degC_ || mode_ != OperationMode::NORMAL || callback_ == nullptr) return -1;
        if (last_degC_) {
            if (std::abs(*newest_degC_ - *last_degC_) < kResolution_degC) return -1;
            if (now_ns() < last_at_ns_ + period_ns_) return last_at_ns_ + period_ns_;
        }
        Event event{};
        event.sensorType = SensorType::AMBIENT_TEMPERATURE;
        event.u.scalar = *newest_degC_;
        post(event);
        last_degC_ = newest_degC_;
        last_at_ns_ = now_ns();
        return -1;
    }

    // Under the lock, so that none follows a deactivation.
    void post(Event& event) {
        event.timestamp = now_ns();
        event.sensorHandle = kHandle;
        callback_->postEvents(std::vector<Event>{event}, callback_->createScopedWakelock(false));
    }

    std::mutex mutex_;
    sp<IHalProxyCallback> callback_;
    OperationMode mode_ = OperationMode::NORMAL;
    bool is_active_ = false;
    int64_t period_ns_ = kSecond_ns;
    std::optional<float> newest_degC_;  // what the daemon said last; nothing where it trusts none
    std::optional<float> last_degC_;    // what was reported last, since the activation
    int64_t last_at_ns_ = 0;
    int64_t retry_at_ns_ = 0;
    Connection connection_;
    const int wake_;
    std::thread worker_;  // the last member: it uses the others
};

}  // namespace

ISensorsSubHal* sensorsHalGetSubHal_2_1(uint32_t* version) {
    static auto* const sub_hal = new AmbientSubHal;  // never freed: its worker runs as long as the process
    *version = SUB_HAL_2_1_VERSION;
    return sub_hal;
}
