// SPDX-License-Identifier: BSD-3-Clause
//
// A camera in a process of its own.
#include <ros/ros.h>

#include "camera.hpp"

int main(int count, char **words) {
    ros::init(count, words, "camera");
    // The last handle ends ROS, and with it what could say why this failed.
    const ros::NodeHandle node;
    try {
        uvcam_ros::Camera camera(node, ros::NodeHandle("~"), ros::this_node::getName());
        ros::spin();
    } catch (const std::exception &error) {
        ROS_FATAL("%s: %s", ros::this_node::getName().c_str(), error.what());
        return 1;
    }
}
