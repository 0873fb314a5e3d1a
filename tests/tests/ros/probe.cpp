// A nodelet that writes a line for each image that it gets: stamp in ns, address of the pixels, and whether all of them are black.
#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <fstream>

namespace uvcam_ros_probe {

class Probe : public nodelet::Nodelet {
    void onInit() override {
        file_.open(getPrivateNodeHandle().param<std::string>("file", ""));
        // As UVDAR's detector, but for the queue, from which nothing is to be dropped on a busy machine; ~queue_size = 1 is UVDAR's.
        const int queue_size = getPrivateNodeHandle().param("queue_size", 10000);
        subscriber_ = getMTPrivateNodeHandle().subscribe("image", queue_size, &Probe::received, this);
    }

    void received(const sensor_msgs::ImageConstPtr &image) {
        const auto is_black = [](std::uint8_t pixel) { return pixel == 0; };
        file_ << image->header.stamp.toNSec() << ' ' << static_cast<const void *>(image->data.data()) << ' '
              << std::all_of(image->data.begin(), image->data.end(), is_black) << std::endl;
    }

    std::ofstream file_;
    ros::Subscriber subscriber_;
};

} // namespace uvcam_ros_probe

PLUGINLIB_EXPORT_CLASS(uvcam_ros_probe::Probe, nodelet::Nodelet)
