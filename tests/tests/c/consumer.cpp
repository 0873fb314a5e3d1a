// consumer CAMERA PREFIX ROOT_PATH: a line for each frame, until SIGTERM; then the counters.
#include <csignal>
#include <iostream>

#include <uvcam.hpp>

#include "consumer.h"

int main(int argc, char **argv) try {
    if (argc != 4)
        return 2;
    std::signal(SIGTERM, end);
    uvcam::Subscriber subscriber(argv[1], {argv[2], argv[3]});
    while (!is_over) {
        subscriber.wait(std::chrono::milliseconds(100));
        while (auto frame = subscriber.receive()) {
            const auto pixels = frame->pixels();
            tell(&frame->header(), pixels.data(), pixels.size(), frame->lost_before(), frame->epoch_changed());
        }
        std::fflush(stdout);
    }
    const uvcam::Counters counters = subscriber.counters();
    std::cout << "counters " << counters.frames << " " << counters.lost << " " << counters.epochs << " "
              << counters.rejected << " " << counters.connected << "\n";
    return 0;
} catch (const uvcam::Error &error) {
    std::cerr << error.what() << "\n";
    return 1;
}
