// SPDX-License-Identifier: BSD-3-Clause
//
// Frames of uvcam as OpenCV's matrices, without a copy. Needs opencv_core.
#ifndef UVCAM_OPENCV_HPP
#define UVCAM_OPENCV_HPP

#include <opencv2/core/mat.hpp>

#include "uvcam.hpp"

namespace uvcam {

/// The frame's own pixels as CV_8UC1 or CV_16UC1. Valid as long as the frame: keep the frame, or clone() the matrix. The memory is mapped
/// for reading alone; to write there ends the program.
inline const cv::Mat as_mat(const Frame &frame) {
    const Header &header = frame.header();
    const int type = frame.bytes_per_pixel() == 1 ? CV_8UC1 : CV_16UC1;
    auto *pixels = const_cast<std::uint8_t *>(frame.pixels().data());
    return cv::Mat(static_cast<int>(header.height), static_cast<int>(header.width), type, pixels, header.stride);
}

/// A frame that ends here would leave the matrix without memory.
const cv::Mat as_mat(const Frame &&frame) = delete;

/// The mask's own pixels as CV_8UC1, for the `mask` of OpenCV's functions. Valid as long as the mask, and not to be written to.
inline const cv::Mat as_mat(const Mask &mask) {
    auto *pixels = const_cast<std::uint8_t *>(mask.pixels().data());
    return cv::Mat(static_cast<int>(mask.height()), static_cast<int>(mask.width()), CV_8UC1, pixels);
}

/// A mask that ends here would leave the matrix without memory.
const cv::Mat as_mat(const Mask &&mask) = delete;

} // namespace uvcam

#endif // UVCAM_OPENCV_HPP
