// Drives a sub-HAL as the Multi-HAL does: opens the library, asks it for its sub-HAL, and does what each line of the
// standard input says. Results, and the events that come, are lines of the standard output.

#include <dlfcn.h>
#include <unistd.h>

#include <cstdio>
#include <iostream>
#include <mutex>
#include <sstream>

#include "V2_1/SubHal.h"

namespace sensors = android::hardware::sensors;
using sensors::V1_0::OperationMode;
using sensors::V1_0::Result;
using sensors::V2_1::Event;
using sensors::V2_1::SensorInfo;
using sensors::V2_1::SensorType;

static std::mutex printing;

template <typename... Words>
static void say(const char* form, Words... words) {
    std::lock_guard<std::mutex> lock(printing);
    printf(form, words...);
    fflush(stdout);
}

namespace android::hardware::sensors::V2_0::implementation {
ScopedWakelock::ScopedWakelock(IScopedWakelockRefCounter*, bool locked) : mLocked(locked) {}
ScopedWakelock::~ScopedWakelock() {}
// The class that may make one.
class HalProxyCallbackBase {
  public:
    static ScopedWakelock wakelock(bool locked) { return ScopedWakelock(nullptr, locked); }
};
}  // namespace android::hardware::sensors::V2_0::implementation

struct Callback : sensors::V2_1::implementation::IHalProxyCallback {
    void postEvents(const std::vector<Event>& events, ScopedWakelock wakelock) override {
        for (const Event& event : events) {
            const bool is_value = event.sensorType == SensorType::AMBIENT_TEMPERATURE;
            const double value = is_value ? event.u.scalar : static_cast<double>(event.u.meta.what);
            say("event type=%d handle=%d value=%.3f at=%lld locked=%d\n", static_cast<int>(event.sensorType),
                event.sensorHandle, value, static_cast<long long>(event.timestamp), wakelock.isLocked());
        }
    }
    ScopedWakelock createScopedWakelock(bool lock) override {
        return sensors::V2_0::implementation::HalProxyCallbackBase::wakelock(lock);
    }
};

int main(int, char** arguments) {
    void* const library = dlopen(arguments[1], RTLD_NOW);
    if (library == nullptr) {
        say("%s\n", dlerror());
        return 1;
    }
    const auto get = reinterpret_cast<decltype(&sensorsHalGetSubHal_2_1)>(dlsym(library, "sensorsHalGetSubHal_2_1"));
    uint32_t version = 0;
    auto* const hal = get(&version);
    Callback callback;
    say("loaded %s version=%#x\n", hal->getName().c_str(), version);

    std::string line;
    while (std::getline(std::cin, line)) {
        std::istringstream words(line);
        std::string what;
        int64_t number = 0, handle = 1;
        words >> what >> number >> handle;
        Result result = Result::OK;
        if (what == "initialize") {
            result = hal->initialize(android::sp<sensors::V2_1::implementation::IHalProxyCallback>(&callback));
        } else if (what == "list") {
            hal->getSensorsList_2_1([](const auto& list) {
                for (const SensorInfo& each : list) {
                    say("sensor handle=%d type=%d %s flags=%u permission='%s' delay=%d..%d fifo=%u\n",
                        each.sensorHandle, static_cast<int>(each.type), each.typeAsString.c_str(), each.flags,
                        each.requiredPermission.c_str(), each.minDelay, each.maxDelay, each.fifoMaxEventCount);
                }
            });
        } else if (what == "activate") {
            result = hal->activate(handle, number != 0);
        } else if (what == "batch") {
            result = hal->batch(handle, number, 0);
        } else if (what == "flush") {
            result = hal->flush(handle);
        } else if (what == "mode") {
            result = hal->setOperationMode(static_cast<OperationMode>(number));
        } else if (what == "inject") {
            Event event{};
            event.sensorHandle = handle;
            event.sensorType = SensorType::AMBIENT_TEMPERATURE;
            event.u.scalar = number;
            result = hal->injectSensorData_2_1(event);
        } else if (what == "channel") {
            hal->registerDirectChannel({}, [&](Result said, int32_t) { result = said; });
        } else if (what == "debug") {
            const native_handle_t handle{sizeof(native_handle_t), 1, 0, {STDOUT_FILENO}};
            hal->debug(&handle, {});
        }
        say("%s %d\n", what.c_str(), static_cast<int>(result));
    }
    _exit(0);  // as the worker goes on
}
