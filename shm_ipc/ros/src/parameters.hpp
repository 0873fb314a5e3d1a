// SPDX-License-Identifier: BSD-3-Clause
#ifndef UVCAM_ROS_PARAMETERS_HPP
#define UVCAM_ROS_PARAMETERS_HPP

#include <ros/node_handle.h>

#include <string>

#include <uvcam.hpp>

namespace uvcam_ros {

/// What a launch file says of a camera. README.md describes each.
struct Parameters {
    std::string camera;
    uvcam::Settings settings;
    uvcam_wakeup wakeup;
    std::string frame_id;
    std::string camera_name;
    std::string calib_url;
    std::uint32_t queue_size;
    std::uint32_t fill_lost;
    bool allow_unmasked;
};

/// Reads the parameters below `node`; `name` is that of the node or nodelet. Warns of those that are not read here. Throws
/// std::invalid_argument where a value cannot be.
Parameters read_parameters(const ros::NodeHandle &node, const std::string &name);

} // namespace uvcam_ros

#endif // UVCAM_ROS_PARAMETERS_HPP
