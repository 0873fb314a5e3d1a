// expected CAMERA PREFIX ROOT_PATH: C++20 without exceptions.
#include <span>
#include <type_traits>

#include <uvcam.hpp>

#include "check.h"

static_assert(std::is_same_v<uvcam::Span<const std::uint8_t>, std::span<const std::uint8_t>>);
static_assert(!std::is_copy_constructible_v<uvcam::Frame> && !std::is_copy_assignable_v<uvcam::Frame>);
static_assert(std::is_nothrow_move_constructible_v<uvcam::Frame> && std::is_nothrow_move_assignable_v<uvcam::Frame>);
static_assert(!std::is_copy_constructible_v<uvcam::Subscriber> && std::is_nothrow_move_constructible_v<uvcam::Subscriber>);

namespace {

constexpr auto PATIENCE = std::chrono::seconds(20);

uvcam::Frame received(uvcam::Subscriber &subscriber) {
    for (;;) {
        auto frame = subscriber.try_receive();
        CHECK(frame);
        if (*frame)
            return *std::move(*frame);
        auto came = subscriber.try_wait(PATIENCE);
        CHECK(came && *came);
    }
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 4)
        return 2;
    const uvcam::Settings settings = {argv[2], argv[3]};
    const auto refused = uvcam::Subscriber::try_open("no/name", settings);
    CHECK(!refused && refused.error().status() == UVCAM_ERROR_ARGUMENT);
    CHECK(std::string(refused.error().what()).find("\"no/name\"") != std::string::npos);

    std::optional<uvcam::Frame> kept;
    {
        auto opened = uvcam::Subscriber::try_open(argv[1], settings);
        CHECK(opened);
        uvcam::Subscriber subscriber = *std::move(opened);
        CHECK(subscriber.try_set_wakeup(UVCAM_WAKEUP_PREDICTIVE));
        kept = received(subscriber);
        // A frame that is assigned to gives its slot back: more come than may be held.
        for (int count = 0; count < 10; ++count)
            kept = received(subscriber);
        std::optional<uvcam::Mask> mask;
        while (!mask) {
            auto asked = subscriber.try_mask_of(*kept, 3);
            CHECK(asked ? asked->has_value() : asked.error().status() == UVCAM_ERROR_MASK_PENDING);
            if (asked)
                mask = *std::move(asked);
            else
                CHECK(subscriber.try_wait(std::chrono::milliseconds(1)));
        }
        // The mask of the test blanks the lower 40 rows, here 3 more.
        CHECK(mask->id() == kept->mask_id() && mask->masked_px() == 752 * 40 && mask->runs().size() == 40);
        CHECK(mask->pixels()[752 * 436] == 255 && mask->pixels()[752 * 437] == 0);
        CHECK(subscriber.try_wait(PATIENCE).has_value());
        CHECK(subscriber.try_receive_latest());
        auto counters = subscriber.try_counters();
        CHECK(counters && counters->frames >= 11 && counters->connected && counters->epochs == 1);
    }
    // Its subscriber is gone.
    const uvcam::Frame frame = *std::move(kept);
    const std::span<const std::uint8_t> pixels = frame.pixels();
    CHECK(frame.header().width == 752 && frame.header().height == 480 && frame.bytes_per_pixel() == 1);
    CHECK(pixels.size() == 752 * 480);
    CHECK(frame.row(1).data() == pixels.data() + frame.header().stride && frame.row(1).size() == 752);
    CHECK(frame.row(480).empty());
    CHECK(frame.is_masked() && frame.mask_id() != uvcam::MaskId{});
    CHECK(frame.mid_exposure() < std::chrono::steady_clock::now());
    CHECK(frame.mid_exposure() > std::chrono::steady_clock::now() - PATIENCE);

    auto nobody = uvcam::HealthReader::try_open("nobody", settings);
    CHECK(nobody && !*nobody);
    auto reader = uvcam::HealthReader::try_open(argv[1], settings);
    CHECK(reader && *reader);
    auto health = (*reader)->try_read(PATIENCE);
    CHECK(health && *health && (*health)->state == UVCAM_STATE_STREAMING);
    std::puts("as expected");
    return 0;
}
