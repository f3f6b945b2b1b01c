// Stands in for the Multi-HAL's V2_1/SubHal.h and V2_0/ScopedWakelock.h: the interface by which it drives a sub-HAL.
#pragma once

#include <android/hardware/sensors/2.1/ISensors.h>

#define SUB_HAL_2_1_VERSION 0x02010000

namespace android::hardware::sensors {
namespace V2_0::implementation {

class IScopedWakelockRefCounter;

class ScopedWakelock {
  public:
    ScopedWakelock(ScopedWakelock&&) = default;
    virtual ~ScopedWakelock();
    bool isLocked() const { return mLocked; }

  private:
    friend class HalProxyCallbackBase;
    ScopedWakelock(IScopedWakelockRefCounter*, bool);
    bool mLocked;
};

}  // namespace V2_0::implementation

namespace V2_1::implementation {

struct IHalProxyCallback : ISensorsCallback {
    using ScopedWakelock = V2_0::implementation::ScopedWakelock;
    virtual void postEvents(const std::vector<Event>&, ScopedWakelock) = 0;
    virtual ScopedWakelock createScopedWakelock(bool lock) = 0;
};

// What a sub-HAL has no use for is final, and refuses.
struct ISensorsSubHal : ISensors {
    Return<void> getSensorsList(getSensorsList_cb) final { return Void(); }
    Return<V1_0::Result> initialize(const MQDescriptorSync<V1_0::Event>&, const MQDescriptorSync<uint32_t>&,
                                    const sp<V2_0::ISensorsCallback>&) final {
        return V1_0::Result::INVALID_OPERATION;
    }
    Return<V1_0::Result> initialize_2_1(const MQDescriptorSync<Event>&, const MQDescriptorSync<uint32_t>&,
                                        const sp<ISensorsCallback>&) final {
        return V1_0::Result::INVALID_OPERATION;
    }
    Return<V1_0::Result> injectSensorData(const V1_0::Event&) final { return V1_0::Result::INVALID_OPERATION; }
    virtual Return<void> debug(const hidl_handle&, const hidl_vec<hidl_string>&) = 0;
    virtual const std::string getName() = 0;
    virtual Return<V1_0::Result> initialize(const sp<IHalProxyCallback>&) = 0;
};

}  // namespace V2_1::implementation
}  // namespace android::hardware::sensors

extern "C" __attribute__((visibility("default")))
android::hardware::sensors::V2_1::implementation::ISensorsSubHal* sensorsHalGetSubHal_2_1(uint32_t* version);
