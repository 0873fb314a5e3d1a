// ROS 1: sensor_msgs/Image of the driver's frames, by the package shm_ipc/ros, shared with a consumer in the same process.
//
// The way is `consume`. A frame counts when the consumer's callback begins: it is masked. When it was ready is told by its header, which
// the consumer reads by itself afterwards.

#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <cctype>
#include <deque>

#include "camera.hpp"
#include "peer.hpp"

// As SharedMemory::settings_in.
static uvcam::Settings settings_in(const std::string &folder) {
    std::string prefix;
    std::copy_if(folder.begin(), folder.end(), std::back_inserter(prefix), [](unsigned char c) { return std::isalnum(c); });
    return {prefix + "_", folder};
}

struct Camera {
    uvcam::Subscriber headers;
    std::unique_ptr<uvcam_ros::Camera> bridge;
    ros::Subscriber subscriber;

    void received(Window &window, size_t index, const sensor_msgs::ImageConstPtr &image) {
        const uint64_t now_ns = monotonic_ns();
        while (auto frame = headers.receive()) {
            const auto &header = frame->header();
            if (header.mid_exposure_realtime_ns == image->header.stamp.toNSec()) {
                window.count(index, header.device_frame_id, header.arrival_monotonic_ns, now_ns);
                return;
            }
        }
    }
};

int main(int count, char **words) {
    Task task(count, words);
    ros::init(count, words, "uvcam", ros::init_options::NoSigintHandler | ros::init_options::NoRosout);
    // Standard output is the bench's.
    ros::console::set_logger_level("ros", ros::console::levels::Error);
    ros::NodeHandle node;
    Window window(task);
    std::deque<Camera> cameras;
    for (size_t index = 0; index < task.cameras; index++) {
        const std::string name = "camera" + std::to_string(index);
        const auto settings = settings_in(task.folder);
        ros::NodeHandle own(node, name);
        own.setParam("prefix", settings.prefix), own.setParam("root_path", settings.root_path);
        Camera &camera = cameras.emplace_back(Camera{uvcam::Subscriber(name, settings), nullptr, {}});
        boost::function<void(const sensor_msgs::ImageConstPtr &)> received =
            [&window, &camera, index](const sensor_msgs::ImageConstPtr &image) { camera.received(window, index, image); };
        camera.subscriber = own.subscribe<sensor_msgs::Image>("image_raw", 1, received);
        camera.bridge = std::make_unique<uvcam_ros::Camera>(node, own, "/" + name);
    }
    ros::AsyncSpinner spinner(task.cameras);
    spinner.start();
    window.conduct();
    cameras.clear();
    ros::shutdown();
    _exit(0);
}
