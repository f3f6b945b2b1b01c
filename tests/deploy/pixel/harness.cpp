// Runs the Pixel thermal HAL's ThermalHelperImpl, compiled with its sources as one: a line of input is a number of seconds
// for which the watcher's callback is called as often as it asks for. Then every sensor is printed, and "." at the end.
#include "thermal-helper.h"

namespace aidl::android::hardware::thermal::implementation {

static WatcherCallback watch;
void ThermalWatcher::registerFilesToWatch(const std::set<std::string>&) {}
void ThermalWatcher::registerFilesToWatchNl(const std::set<std::string>&) {}
bool ThermalWatcher::threadLoop() { return false; }
bool ThermalWatcher::startWatchingDeviceFiles() {
    watch = cb_;
    return true;
}
void ThermalWatcher::wake() {}

PowerHalService::PowerHalService() : power_hal_aidl_exist_(false) {}
bool PowerHalService::connect() { return false; }
void PowerHalService::reconnect() {}
void PowerHalService::setMode(const std::string&, const ThrottlingSeverity&, const bool&, const bool) {}
void PowerHalService::updateSupportedPowerHints(const std::unordered_map<std::string, SensorInfo>&) {}
void PowerHalService::sendPowerExtHint(const Temperature&) {}

}  // namespace aidl::android::hardware::thermal::implementation

using namespace aidl::android::hardware::thermal;
using ::android::base::boot_clock;

int main() {
    implementation::ThermalHelperImpl hal([](const Temperature&) {});
    for (double for_s; std::cin >> for_s;) {
        for (const auto end = boot_clock::at + for_s * 1s; boot_clock::at < end;)
            boot_clock::at += implementation::watch({}) + 1ms;
        for (const auto& [name, status] : hal.GetSensorStatusMap()) {
            Temperature read;
            if (hal.readTemperature(name, &read))
                std::cout << name << " " << read.value << " " << toString(status.severity) << "\n";
        }
        std::cout << "." << std::endl;
    }
}
