// Stands in for what an AOSP build gives a sub-HAL: libutils, libhidlbase and hidl-gen's android.hardware.sensors@1.0 to
// @2.1. Only what the sub-HAL and the harness use is here, in our own words; the numbers are the interface's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

struct native_handle_t {
    int version;
    int numFds;
    int numInts;
    int data[1];
};

namespace android {

class RefBase {
  public:
    virtual ~RefBase() = default;
};

// Counts nothing: what the harness hands over lives as long as it.
template <typename T>
class sp {
  public:
    sp(T* object = nullptr) : object_(object) {}
    T* operator->() const { return object_; }
    bool operator==(std::nullptr_t) const { return object_ == nullptr; }

  private:
    T* object_;
};

namespace hardware {

template <typename T>
class Return {
  public:
    Return(T value) : value_(value) {}
    operator T() const { return value_; }

  private:
    T value_;
};
template <>
class Return<void> {};
inline Return<void> Void() { return {}; }

using hidl_string = std::string;
template <typename T>
using hidl_vec = std::vector<T>;
template <typename T>
struct MQDescriptorSync {};

class hidl_handle {
  public:
    hidl_handle(const native_handle_t* handle) : handle_(handle) {}
    const native_handle_t* getNativeHandle() const { return handle_; }

  private:
    const native_handle_t* handle_;
};

namespace sensors {
namespace V1_0 {

enum class Result : int32_t { OK = 0, BAD_VALUE = -22, INVALID_OPERATION = -38 };
enum class OperationMode : int32_t { NORMAL = 0, DATA_INJECTION = 1 };
enum class RateLevel : int32_t { STOP = 0 };
enum class SensorFlagBits : uint32_t { ON_CHANGE_MODE = 2 };
enum class MetaDataEventType : uint32_t { META_DATA_FLUSH_COMPLETE = 1 };
struct MetaData {
    MetaDataEventType what;
};
union EventPayload {
    MetaData meta;
    float scalar;
    float data[16];
};
struct Event {};
struct SensorInfo {};
struct SharedMemInfo {};

}  // namespace V1_0

namespace V2_0 {

enum class SensorTimeout : int32_t { WAKE_LOCK_SECONDS = 1 };
struct ISensorsCallback : virtual RefBase {};

struct ISensors : virtual RefBase {
    using getSensorsList_cb = std::function<void(const hidl_vec<V1_0::SensorInfo>&)>;
    using registerDirectChannel_cb = std::function<void(V1_0::Result, int32_t)>;
    using configDirectReport_cb = std::function<void(V1_0::Result, int32_t)>;
    virtual Return<void> getSensorsList(getSensorsList_cb) = 0;
    virtual Return<V1_0::Result> setOperationMode(V1_0::OperationMode) = 0;
    virtual Return<V1_0::Result> activate(int32_t, bool) = 0;
    virtual Return<V1_0::Result> initialize(const MQDescriptorSync<V1_0::Event>&, const MQDescriptorSync<uint32_t>&,
                                            const sp<ISensorsCallback>&) = 0;
    virtual Return<V1_0::Result> batch(int32_t, int64_t, int64_t) = 0;
    virtual Return<V1_0::Result> flush(int32_t) = 0;
    virtual Return<V1_0::Result> injectSensorData(const V1_0::Event&) = 0;
    virtual Return<void> registerDirectChannel(const V1_0::SharedMemInfo&, registerDirectChannel_cb) = 0;
    virtual Return<V1_0::Result> unregisterDirectChannel(int32_t) = 0;
    virtual Return<void> configDirectReport(int32_t, int32_t, V1_0::RateLevel, configDirectReport_cb) = 0;
};

}  // namespace V2_0

namespace V2_1 {

enum class SensorType : int32_t { META_DATA = 0, AMBIENT_TEMPERATURE = 13 };
struct Event {
    int64_t timestamp;
    int32_t sensorHandle;
    SensorType sensorType;
    V1_0::EventPayload u;
};
struct SensorInfo {
    int32_t sensorHandle;
    hidl_string name, vendor;
    int32_t version;
    SensorType type;
    hidl_string typeAsString;
    float maxRange, resolution, power;
    int32_t minDelay;
    uint32_t fifoReservedEventCount, fifoMaxEventCount;
    hidl_string requiredPermission;
    int32_t maxDelay;
    uint32_t flags;
};
struct ISensorsCallback : virtual RefBase {};

struct ISensors : V2_0::ISensors {
    using getSensorsList_2_1_cb = std::function<void(const hidl_vec<SensorInfo>&)>;
    virtual Return<void> getSensorsList_2_1(getSensorsList_2_1_cb) = 0;
    virtual Return<V1_0::Result> initialize_2_1(const MQDescriptorSync<Event>&, const MQDescriptorSync<uint32_t>&,
                                                const sp<ISensorsCallback>&) = 0;
    virtual Return<V1_0::Result> injectSensorData_2_1(const Event&) = 0;
};

}  // namespace V2_1
}  // namespace sensors
}  // namespace hardware
}  // namespace android
