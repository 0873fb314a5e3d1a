// latency CAMERA PREFIX ROOT_PATH FRAMES: a line for each frame, nanoseconds from the send until it was there.
#include <cstdio>
#include <vector>

#include <uvcam.hpp>

int main(int argc, char **argv) try {
    if (argc != 5)
        return 2;
    const std::size_t frames = std::stoul(argv[4]);
    std::vector<long long> latencies;
    latencies.reserve(frames);
    uvcam::Subscriber subscriber(argv[1], {argv[2], argv[3]});
    while (latencies.size() < frames) {
        subscriber.wait(std::chrono::seconds(1));
        while (latencies.size() < frames) {
            auto frame = subscriber.receive();
            if (!frame)
                break;
            const auto now = std::chrono::steady_clock::now().time_since_epoch();
            latencies.push_back(std::chrono::nanoseconds(now).count() - static_cast<long long>(frame->header().send_monotonic_ns));
        }
    }
    for (long long latency : latencies)
        std::printf("%lld\n", latency);
    return 0;
} catch (const uvcam::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
