// masks CAMERA PREFIX ROOT_PATH: each frame with its own mask, until SIGTERM. The masks of the test keep their number in every byte of
// their identity, and mask as many columns from the second on.
#include <algorithm>
#include <csignal>

#include <uvcam.hpp>

#include "check.h"
#include "consumer.h"

namespace {

void compare(const uvcam::Frame &frame, const uvcam::Mask &mask, std::uint32_t grown_by) {
    const std::uint32_t number = frame.mask_id()[0];
    CHECK(mask.id() == frame.mask_id() && mask.width() == frame.header().width && mask.height() == frame.header().height);
    CHECK(mask.pixels().size() == std::size_t{mask.width()} * mask.height());
    CHECK(mask.masked_px() == std::uint64_t{number} * mask.height() && mask.runs().size() == mask.height());
    CHECK(mask.runs()[1].row == 1 && mask.runs()[1].start == 2 && mask.runs()[1].length == number);
    CHECK(mask.provenance() == "{\"method\": \"by hand\"}");
    const std::uint32_t begin = grown_by > 2 ? 0 : 2 - grown_by, end = 2 + number + grown_by;
    for (std::uint32_t y = 0; y < mask.height(); ++y)
        for (std::uint32_t x = 0; x < mask.width(); ++x) {
            const bool is_masked = mask.pixels()[std::size_t{y} * mask.width() + x] == 0;
            CHECK(is_masked == (x >= begin && x < end));
            // Frames are white where they are not blanked.
            CHECK((frame.row(y)[x] == 0) == (x >= 2 && x < 2 + number));
        }
}

} // namespace

int main(int argc, char **argv) try {
    if (argc != 4)
        return 2;
    std::signal(SIGTERM, end);
    uvcam::Subscriber subscriber(argv[1], {argv[2], argv[3]});
    std::optional<uvcam::Mask> kept;
    while (!is_over) {
        subscriber.wait(std::chrono::milliseconds(100));
        while (auto frame = subscriber.receive()) {
            auto mask = subscriber.try_mask_of(*frame);
            while (!mask && !is_over) {
                CHECK(mask.error().status() == UVCAM_ERROR_MASK_PENDING);
                subscriber.wait(std::chrono::milliseconds(1));
                mask = subscriber.try_mask_of(*frame);
            }
            CHECK(mask && *mask && is_shared((*mask)->pixels().data(), (*mask)->pixels().size()));
            compare(*frame, **mask, 0);
            const auto grown = subscriber.mask_of(*frame, 5);
            compare(*frame, *grown, 5);
            kept = *std::move(mask);
            std::printf("mask %d\n", kept->id()[0]);
            std::fflush(stdout);
        }
    }
    // Handles are none of the library's memory: what is released is not found again.
    uvcam_mask *mask = nullptr;
    CHECK_FAILS(uvcam_mask_release(mask), UVCAM_ERROR_ARGUMENT, "NULL is not a mask");
    CHECK_FAILS(uvcam_mask_release(reinterpret_cast<uvcam_mask *>(&mask)), UVCAM_ERROR_HANDLE, "is not a mask");
    return 0;
} catch (const uvcam::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
