// UVDAR's rule for blinking markers, on live frames: prints where they are.
//
//     c++ -std=c++17 -O2 uvdar_markers.cpp $(pkg-config --cflags --libs uvcam) -o uvdar_markers
//     ./uvdar_markers CAMERA [PREFIX ROOT_PATH]
//
// A marker is a small bright spot: a pixel of at least THRESHOLD that is brighter, by half of that, than all pixels on a ring around it.
// Where a ring of radius 3 tells neither a marker nor the sun, which is as bright all around, one of radius 4 does. Pixels of one spot
// are merged. Frames of 8 bits.
#include <algorithm>
#include <cstdio>
#include <initializer_list>
#include <vector>

#include <uvcam.hpp>

namespace {

constexpr int THRESHOLD = 50;
constexpr int SUN = 150;
constexpr int MERGE_PX = 5;

struct Point {
    int x, y;
};

// One eighth of a circle; the others mirror it.
constexpr Point RING3[] = {{3, 0}, {3, 1}, {2, 2}};
constexpr Point RING4[] = {{4, 0}, {4, 1}, {3, 2}};

enum class Verdict { NONE, MARKER, SUN };

template <std::size_t N> Verdict judge(const uvcam::Frame &frame, int x, int y, int centre, const Point (&ring)[N]) {
    const std::uint8_t *pixels = frame.pixels().data();
    int low = 255, high = 0;
    for (auto [a, b] : ring)
        for (auto [dx, dy] : {Point{a, b}, {b, a}, {-a, b}, {b, -a}, {a, -b}, {-b, a}, {-a, -b}, {-b, -a}}) {
            const auto row = static_cast<std::size_t>(y + dy) * frame.header().stride;
            const int pixel = pixels[row + static_cast<std::size_t>(x + dx)];
            low = std::min(low, pixel);
            high = std::max(high, pixel);
        }
    if (centre - high >= THRESHOLD / 2)
        return Verdict::MARKER;
    return centre >= SUN && centre - low <= THRESHOLD / 2 ? Verdict::SUN : Verdict::NONE;
}

std::vector<Point> markers(const uvcam::Frame &frame) {
    const int width = static_cast<int>(frame.header().width), height = static_cast<int>(frame.header().height);
    std::vector<Point> found;
    for (int y = 4; y < height - 4; ++y) {
        const auto row = frame.row(static_cast<std::size_t>(y));
        for (int x = 4; x < width - 4; ++x) {
            const int centre = row[static_cast<std::size_t>(x)];
            if (centre < THRESHOLD)
                continue;
            Verdict verdict = judge(frame, x, y, centre, RING3);
            if (verdict == Verdict::NONE)
                verdict = judge(frame, x, y, centre, RING4);
            if (verdict != Verdict::MARKER)
                continue;
            const bool is_new = std::none_of(found.begin(), found.end(), [=](Point other) {
                return (other.x - x) * (other.x - x) + (other.y - y) * (other.y - y) < MERGE_PX * MERGE_PX;
            });
            if (is_new)
                found.push_back({x, y});
        }
    }
    return found;
}

} // namespace

int main(int argc, char **argv) try {
    if (argc != 2 && argc != 4) {
        std::fprintf(stderr, "usage: %s CAMERA [PREFIX ROOT_PATH]\n", argv[0]);
        return 2;
    }
    uvcam::Settings settings;
    if (argc == 4)
        settings = {argv[2], argv[3]};
    uvcam::Subscriber subscriber(argv[1], settings);
    for (;;) {
        subscriber.wait(std::chrono::seconds(1));
        while (auto frame = subscriber.receive()) {
            if (frame->header().pixel_format != UVCAM_MONO8) {
                std::fprintf(stderr, "frames of %zu bytes a pixel: this example reads those of one\n", frame->bytes_per_pixel());
                return 1;
            }
            if (!frame->is_masked())
                std::fprintf(stderr, "no mask: the own airframe is in sight\n");
            // A frame is a bit of a marker's code: who decodes it must know of each that is missing.
            std::printf("frame %llu, %llu lost:", static_cast<unsigned long long>(frame->header().sequence),
                        static_cast<unsigned long long>(frame->lost_before()));
            for (Point marker : markers(*frame))
                std::printf(" %d,%d", marker.x, marker.y);
            std::printf("\n");
        }
        std::fflush(stdout);
    }
} catch (const uvcam::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
