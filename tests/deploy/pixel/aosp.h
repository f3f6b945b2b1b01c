// Stands in for what an AOSP build gives the Pixel thermal HAL: libbase, libutils, libcutils, libnl and what is generated
// from AIDL. Only what the HAL uses is here, in our own words. Two things are not as in AOSP, so that a test can run the
// HAL's sources as they are: every path lies under $HAL_ROOT, and the clock is moved by the harness.
#pragma once

#include <dirent.h>
#include <inttypes.h>
#include <math.h>

#include <bits/stdc++.h>

using namespace std::chrono_literals;

inline std::string in_root(const std::string& path) { return std::getenv("HAL_ROOT") + path; }
inline DIR* opendir_in_root(const char* path) { return opendir(in_root(path).c_str()); }
#define opendir opendir_in_root

#define ATRACE_CALL()
#define ATRACE_NAME(name) static_cast<void>(name)
#define ATRACE_INT(name, value) static_cast<void>(name)

enum LogSeverity { VERBOSE, INFO, WARNING, ERROR, FATAL };
struct LogLine : std::ostringstream {
    LogSeverity severity;
    explicit LogLine(LogSeverity severity) : severity(severity) {}
    ~LogLine() {
        if (severity >= WARNING) std::cerr << str() << std::endl;
        if (severity == FATAL) std::_Exit(134);
    }
};
#define LOG(severity) static_cast<std::ostream&&>(LogLine(severity))
#define PLOG(severity) LOG(severity)

namespace android {
template <typename T>
using sp = std::shared_ptr<T>;
constexpr int NO_ERROR = 0;
struct Looper {
    explicit Looper(bool) {}
};
struct Thread {
    explicit Thread(bool) {}
    virtual ~Thread() = default;
    virtual bool threadLoop() = 0;
};

namespace base {
struct unique_fd {};
struct boot_clock {
    using duration = std::chrono::nanoseconds;
    using time_point = std::chrono::time_point<boot_clock, duration>;
    static inline time_point at{std::chrono::hours(1)};
    static time_point now() { return at; }
};
inline bool GetBoolProperty(const std::string&, bool otherwise) { return otherwise; }
inline std::string GetProperty(const std::string&, const std::string& otherwise) { return otherwise; }
inline bool ReadFileToString(const std::string& path, std::string* text) {
    std::ifstream file(in_root(path));
    text->assign(std::istreambuf_iterator<char>(file), {});
    return file.is_open();
}
inline bool WriteStringToFile(const std::string& text, const std::string& path) {
    return static_cast<bool>(std::ofstream(in_root(path)) << text << std::flush);
}
inline std::string StringPrintf(const char* format, ...) {
    char text[4096];
    va_list values;
    va_start(values, format);
    vsnprintf(text, sizeof text, format, values);
    va_end(values);
    return text;
}
inline bool StartsWith(std::string_view text, std::string_view start) { return text.starts_with(start); }
inline std::string Trim(const std::string& text) {
    size_t start = text.find_first_not_of(" \t\r\n"), end = text.find_last_not_of(" \t\r\n");
    return start == std::string::npos ? "" : text.substr(start, end - start + 1);
}
inline std::vector<std::string> Split(const std::string& text, const std::string& any_of) {
    std::vector<std::string> parts;
    for (size_t start = 0, end;; start = end + 1) {
        end = text.find_first_of(any_of, start);
        parts.push_back(text.substr(start, end - start));
        if (end == std::string::npos) return parts;
    }
}
}  // namespace base

namespace hardware::google::pixel::PixelAtoms {
struct Atom {
    enum { kThermalSensorAbnormalityDetected, kVendorTempResidencyStats, kVendorSensorCoolingDeviceStats };
};
struct ThermalSensorAbnormalityDetected {
    enum AbnormalityType { UNKNOWN, SENSOR_STUCK, EXTREME_HIGH_TEMP, EXTREME_LOW_TEMP, TEMP_READ_FAIL };
    enum { kTypeFieldNumber = 2, kSensorFieldNumber, kTempFieldNumber };
};
}  // namespace hardware::google::pixel::PixelAtoms
}  // namespace android

inline bool AServiceManager_isDeclared(const char*) { return false; }
inline void* AServiceManager_waitForService(const char*) { return nullptr; }

namespace ndk {
struct SpAIBinder {
    explicit SpAIBinder(void*) {}
};
struct ScopedAIBinder_DeathRecipient {};
struct ScopedAStatus {
    bool isOk() const { return true; }
};

// An AIDL enum's values with their names, in the order of its numbers from -1 on.
template <typename T>
struct names;
template <typename T>
struct enum_range {
    static constexpr auto values = [] {
        std::array<T, names<T>::count> all{};
        for (int each = 0; each < names<T>::count; ++each) all[each] = static_cast<T>(each + names<T>::first);
        return all;
    }();
    constexpr auto begin() const { return values.begin(); }
    constexpr auto end() const { return values.end(); }
};
}  // namespace ndk

#define AIDL_ENUM(name, from, ...)                                                        \
    namespace aidl::android::hardware::thermal {                                          \
    enum class name : int { BEFORE = from - 1, __VA_ARGS__, AFTER };                      \
    inline std::string toString(name value) {                                             \
        std::string all = #__VA_ARGS__;                                                   \
        for (int left = static_cast<int>(value) - (from); left > 0; --left) all.erase(0, all.find(',') + 1); \
        return ::android::base::Trim(all.substr(0, all.find(',')));                       \
    }                                                                                     \
    }                                                                                     \
    template <>                                                                           \
    struct ndk::names<aidl::android::hardware::thermal::name> {                           \
        static constexpr int first = from;                                                \
        static constexpr int count = static_cast<int>(aidl::android::hardware::thermal::name::AFTER) - (from); \
    };
AIDL_ENUM(ThrottlingSeverity, 0, NONE, LIGHT, MODERATE, SEVERE, CRITICAL, EMERGENCY, SHUTDOWN)
AIDL_ENUM(CoolingType, 0, FAN, BATTERY, CPU, GPU, MODEM, NPU, COMPONENT, TPU, POWER_AMPLIFIER, DISPLAY, SPEAKER, WIFI,
          CAMERA, FLASHLIGHT, USB_PORT)
AIDL_ENUM(TemperatureType, -1, UNKNOWN, CPU, GPU, BATTERY, SKIN, USB_PORT, POWER_AMPLIFIER, BCL_VOLTAGE, BCL_CURRENT,
          BCL_PERCENTAGE, NPU, TPU, DISPLAY, MODEM, SOC, WIFI, CAMERA, FLASHLIGHT, SPEAKER, AMBIENT, POGO)

namespace aidl::android::hardware::thermal {
struct Temperature {
    TemperatureType type;
    std::string name;
    float value;
    ThrottlingSeverity throttlingStatus;
};
struct TemperatureThreshold {
    TemperatureType type;
    std::string name;
    std::vector<float> hotThrottlingThresholds, coldThrottlingThresholds;
};
struct CoolingDevice {
    CoolingType type;
    std::string name;
    int64_t value;
};
}  // namespace aidl::android::hardware::thermal
namespace aidl::android::hardware::power {
struct IPower {};
}  // namespace aidl::android::hardware::power
namespace aidl::google::hardware::power::extension::pixel {
struct IPowerExt {};
}  // namespace aidl::google::hardware::power::extension::pixel
namespace aidl::android::frameworks::stats {
struct VendorAtomValue {
    enum Tag { intValue, longValue, floatValue, stringValue };
    std::any value;
    template <Tag tag, typename T>
    void set(T given) { value = given; }
    template <Tag tag, typename T>
    static VendorAtomValue make(T given) { return {given}; }
};
struct VendorAtom {
    std::string reverseDomainName;
    int atomId;
    std::vector<VendorAtomValue> values;
};
struct IStats {
    static constexpr const char* descriptor = "IStats";
    static std::shared_ptr<IStats> fromBinder(const ::ndk::SpAIBinder&) { return nullptr; }
    ::ndk::ScopedAStatus reportVendorAtom(const VendorAtom&) { return {}; }
};
}  // namespace aidl::android::frameworks::stats
