// SPDX-License-Identifier: BSD-3-Clause
#ifndef UVCAM_ROS_IMAGES_HPP
#define UVCAM_ROS_IMAGES_HPP

#include <sensor_msgs/Image.h>

#include <vector>

#include <uvcam.hpp>

namespace uvcam_ros {

/// Makes messages of frames. A message that no subscriber holds any more is filled again: memory that was just read is written faster
/// than memory that is new.
class Images {
  public:
    /// The frame's pixels in a message, without padding. The header is left to the caller.
    sensor_msgs::ImagePtr copy_of(const uvcam::Frame &frame);
    /// An image of the frame's size and encoding, all black.
    sensor_msgs::ImagePtr black_like(const uvcam::Frame &frame);

  private:
    sensor_msgs::ImagePtr shaped_as(const uvcam::Frame &frame);

    std::vector<sensor_msgs::ImagePtr> kept_;
};

/// A mask as mono8: 0 discard, 255 keep.
sensor_msgs::ImagePtr image_of(const uvcam::Mask &mask);

} // namespace uvcam_ros

#endif // UVCAM_ROS_IMAGES_HPP
