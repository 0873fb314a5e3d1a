// SPDX-License-Identifier: BSD-3-Clause
#include "images.hpp"

#include <boost/make_shared.hpp>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>

namespace uvcam_ros {
namespace {

/// More than subscribers hold at a time; those that hold more get new ones.
constexpr std::size_t MOST_KEPT = 8;

std::size_t row_bytes(const uvcam::Frame &frame) { return frame.header().width * frame.bytes_per_pixel(); }

} // namespace

sensor_msgs::ImagePtr Images::copy_of(const uvcam::Frame &frame) {
    auto image = shaped_as(frame);
    const auto pixels = frame.pixels();
    if (frame.header().stride == row_bytes(frame)) {
        image->data.assign(pixels.begin(), pixels.end());
        return image;
    }
    image->data.clear();
    for (std::size_t y = 0; y < frame.header().height; ++y) {
        const auto row = frame.row(y);
        image->data.insert(image->data.end(), row.begin(), row.end());
    }
    return image;
}

sensor_msgs::ImagePtr Images::black_like(const uvcam::Frame &frame) {
    auto image = shaped_as(frame);
    image->data.assign(row_bytes(frame) * frame.header().height, 0);
    return image;
}

sensor_msgs::ImagePtr Images::shaped_as(const uvcam::Frame &frame) {
    // Nobody can begin to hold what this alone holds.
    const auto is_free = [](const sensor_msgs::ImagePtr &image) { return image.use_count() == 1; };
    const auto free = std::find_if(kept_.begin(), kept_.end(), is_free);
    auto image = free != kept_.end() ? *free : boost::make_shared<sensor_msgs::Image>();
    if (free == kept_.end() && kept_.size() < MOST_KEPT)
        kept_.push_back(image);
    namespace encodings = sensor_msgs::image_encodings;
    image->encoding = frame.bytes_per_pixel() == 1 ? encodings::MONO8 : encodings::MONO16;
    image->is_bigendian = 0;
    image->width = frame.header().width;
    image->height = frame.header().height;
    image->step = static_cast<std::uint32_t>(row_bytes(frame));
    return image;
}

sensor_msgs::ImagePtr image_of(const uvcam::Mask &mask) {
    auto image = boost::make_shared<sensor_msgs::Image>();
    image->encoding = sensor_msgs::image_encodings::MONO8;
    image->width = image->step = mask.width();
    image->height = mask.height();
    image->data.assign(mask.pixels().begin(), mask.pixels().end());
    return image;
}

} // namespace uvcam_ros
