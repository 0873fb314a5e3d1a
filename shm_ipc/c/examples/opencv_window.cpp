// Shows the newest frame in a window, without a copy, until a key is pressed.
//
//     c++ -std=c++17 opencv_window.cpp $(pkg-config --cflags --libs uvcam opencv4) -o opencv_window
//     ./opencv_window CAMERA [PREFIX ROOT_PATH]
#include <cstdio>

#include <opencv2/highgui.hpp>
#include <uvcam_opencv.hpp>

int main(int argc, char **argv) try {
    if (argc != 2 && argc != 4) {
        std::fprintf(stderr, "usage: %s CAMERA [PREFIX ROOT_PATH]\n", argv[0]);
        return 2;
    }
    uvcam::Settings settings;
    if (argc == 4)
        settings = {argv[2], argv[3]};
    uvcam::Subscriber subscriber(argv[1], settings);
    do {
        subscriber.wait(std::chrono::milliseconds(100));
        if (auto frame = subscriber.receive_latest())
            cv::imshow(argv[1], uvcam::as_mat(*frame));
    } while (cv::waitKey(1) < 0);
    return 0;
} catch (const uvcam::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
