// What the peers in C++ do as those in Rust (task.rs, source.rs, window.rs).
#pragma once

#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

[[noreturn]] inline void fail(const std::string &what) {
    fprintf(stderr, "%s\n", what.c_str());
    exit(1);
}

inline uint64_t monotonic_ns() {
    timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return uint64_t(now.tv_sec) * 1000000000 + uint64_t(now.tv_nsec);
}

inline void sleep_until(uint64_t instant_ns) {
    timespec time{time_t(instant_ns / 1000000000), long(instant_ns % 1000000000)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr) != 0) {
    }
}

inline void sleep_s(double seconds) { sleep_until(monotonic_ns() + uint64_t(seconds * 1e9)); }

// PROGRAM WAY FOLDER WIDTH HEIGHT CAMERAS SECONDS
struct Task {
    std::string way, folder;
    size_t width, height, cameras;
    double seconds;

    Task(int count, char **words) {
        if (count != 7) fail("usage: PROGRAM WAY FOLDER WIDTH HEIGHT CAMERAS SECONDS");
        way = words[1], folder = words[2];
        width = atoi(words[3]), height = atoi(words[4]), cameras = atoi(words[5]), seconds = atof(words[6]);
    }

    size_t frame_bytes() const { return width * height; }

    std::vector<uint8_t> read(const std::string &name) const {
        std::ifstream file(folder + "/" + name, std::ios::binary);
        std::vector<uint8_t> bytes{std::istreambuf_iterator<char>(file), {}};
        if (bytes.empty() || bytes.size() % frame_bytes()) fail("no pictures of this size in " + folder + "/" + name);
        return bytes;
    }
};

inline void wait_for_end() {
    char bytes[64];
    while (read(STDIN_FILENO, bytes, sizeof bytes) > 0) {
    }
}

// The first bytes of a frame.
struct Stamps {
    uint64_t sequence, ready_ns, send_ns;
};

// One camera: pictures at 60 fps, a part of the period after the camera before.
class Source {
    static constexpr double PERIOD_NS = 1e9 / 60;
    std::shared_ptr<const std::vector<uint8_t>> pictures;
    size_t frame_bytes;
    uint64_t start_ns, sequence = 0;

  public:
    Source(std::shared_ptr<const std::vector<uint8_t>> pictures, const Task &task, size_t camera, uint64_t begin_ns)
        : pictures(pictures), frame_bytes(task.frame_bytes()),
          start_ns(begin_ns + uint64_t(PERIOD_NS * double(camera) / double(task.cameras))) {}

    static std::vector<Source> all(const Task &task) {
        auto pictures = std::make_shared<const std::vector<uint8_t>>(task.read("frames.raw"));
        std::vector<Source> sources;
        uint64_t begin_ns = monotonic_ns();
        for (size_t camera = 0; camera < task.cameras; camera++) sources.emplace_back(pictures, task, camera, begin_ns);
        return sources;
    }

    // Waits until the next frame is due, and writes it with its stamps.
    void expose(uint8_t *frame) {
        sleep_until(start_ns + uint64_t(double(sequence) * PERIOD_NS));
        memcpy(frame, pictures->data() + sequence % (pictures->size() / frame_bytes) * frame_bytes, frame_bytes);
        uint64_t ready_ns = monotonic_ns();
        Stamps stamps{sequence++, ready_ns, ready_ns};
        memcpy(frame, &stamps, sizeof stamps);
    }
};

// Pixels that do not overlap: the compiler makes vector instructions of it.
inline void and_all(uint8_t *__restrict masked, const uint8_t *__restrict frame, const uint8_t *__restrict mask, size_t count) {
    for (size_t pixel = 0; pixel < count; pixel++) masked[pixel] = frame[pixel] & mask[pixel];
}

// Masks frames, and measures.
class Window {
    struct Camera {
        std::mutex mutex;
        std::vector<uint8_t> masked;
        uint64_t seen = 0, last = 0, lost = 0;
        std::vector<uint64_t> latency_ns;
    };
    std::vector<Camera> cameras;
    std::vector<uint8_t> mask;
    double seconds;
    std::atomic<bool> measuring{false};

    static std::string quantiles(std::vector<uint64_t> values_ns) {
        std::sort(values_ns.begin(), values_ns.end());
        auto at = [&](double quantile) {
            if (values_ns.empty()) return std::string("null");
            size_t index = std::min(size_t(double(values_ns.size()) * quantile), values_ns.size() - 1);
            return std::to_string(double(values_ns[index]) / 1000.0);
        };
        return "{\"p50\":" + at(0.5) + ",\"p99\":" + at(0.99) + ",\"max\":" + at(1.0) + "}";
    }

  public:
    explicit Window(const Task &task) : cameras(task.cameras), mask(task.read("mask.raw")), seconds(task.seconds) {
        for (auto &camera : cameras) {
            camera.masked.resize(mask.size());
            camera.latency_ns.reserve(size_t(seconds * 120));
        }
    }

    // Masks a frame of `index` into memory of its own, as a consumer must that shares its message with others.
    void received(size_t index, const uint8_t *frame) {
        Stamps stamps;
        memcpy(&stamps, frame, sizeof stamps);
        {
            std::lock_guard lock(cameras[index].mutex);
            and_all(cameras[index].masked.data(), frame, mask.data(), mask.size());
        }
        count(index, stamps.sequence, stamps.ready_ns, monotonic_ns());
    }

    // Counts a frame that came masked at `masked_ns`.
    void count(size_t index, uint64_t sequence, uint64_t ready_ns, uint64_t masked_ns) {
        Camera &camera = cameras[index];
        std::lock_guard lock(camera.mutex);
        if (measuring) {
            if (sequence > camera.last) camera.lost += sequence - camera.last - 1;
            camera.latency_ns.push_back(masked_ns - ready_ns);
        }
        camera.seen++;
        camera.last = sequence;
    }

    void conduct() {
        uint64_t give_up_ns = monotonic_ns() + 20000000000;
        for (auto &camera : cameras) {
            while (std::lock_guard(camera.mutex), camera.seen == 0) {
                if (monotonic_ns() > give_up_ns) fail("no frame of every camera within 20 s");
                sleep_s(0.01);
            }
        }
        sleep_s(1);
        printf("begin\n"), fflush(stdout);
        measuring = true;
        sleep_s(seconds);
        measuring = false;
        std::vector<uint64_t> latency_ns;
        uint64_t lost = 0;
        for (auto &camera : cameras) {
            std::lock_guard lock(camera.mutex);
            latency_ns.insert(latency_ns.end(), camera.latency_ns.begin(), camera.latency_ns.end());
            lost += camera.lost;
        }
        printf("{\"frames\":%zu,\"lost\":%llu,\"latency_us\":%s}\n", latency_ns.size(), (unsigned long long)lost,
               quantiles(latency_ns).c_str());
        fflush(stdout);
        wait_for_end();
    }
};
