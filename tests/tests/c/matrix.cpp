// matrix CAMERA PREFIX ROOT_PATH: a frame as OpenCV's matrix, in the frame's own memory.
#include <opencv2/core.hpp>
#include <uvcam_opencv.hpp>

#include "check.h"

int main(int argc, char **argv) {
    if (argc != 4)
        return 2;
    uvcam::Subscriber subscriber(argv[1], {argv[2], argv[3]});
    std::optional<uvcam::Frame> frame;
    while (!(frame = subscriber.receive()))
        CHECK(subscriber.wait(std::chrono::seconds(20)));
    const cv::Mat matrix = uvcam::as_mat(*frame);
    CHECK(matrix.data == frame->pixels().data() && matrix.type() == CV_8UC1);
    CHECK(matrix.cols == 752 && matrix.rows == 480 && matrix.step == frame->header().stride);
    // The mask of the test blanks the lower 40 rows.
    CHECK(cv::countNonZero(matrix.rowRange(440, 480)) == 0);
    CHECK(cv::countNonZero(matrix.rowRange(0, 440)) > 0);
    std::puts("a matrix");
    return 0;
}
