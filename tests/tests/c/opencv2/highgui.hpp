// Stands for OpenCV's highgui, which takes a desktop: shows by telling, and presses a key after thirty frames.
#ifndef HIGHGUI_HPP
#define HIGHGUI_HPP

#include <cstdio>

#include <opencv2/core.hpp>

namespace cv {

inline int shown = 0;

inline void imshow(const String &window, InputArray picture) {
    std::printf("%s: %d x %d\n", window.c_str(), picture.cols(), picture.rows());
    shown += 1;
}

inline int waitKey(int) { return shown < 30 ? -1 : 'q'; }

} // namespace cv

#endif
