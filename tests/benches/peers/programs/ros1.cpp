// ROS 1: sensor_msgs/Image over TCP, masked by the consumer, with the steps of the chain that UVDAR flies with.
//
// Ways: `share` is `produce` and `consume` in one process, as two nodelets of one manager. `produce` is a camera driver such as bluefox2: a new message for each frame, filled from the camera's buffer and published as a
// shared pointer. `consume` shares the received message, as UVDAR's detector does, with a thread for each camera. Queues hold one
// message on both sides, transport hints are the default.

#include <boost/make_shared.hpp>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/fill_image.h>
#include <sensor_msgs/image_encodings.h>

#include <thread>

#include "peer.hpp"

static std::string topic(size_t camera) { return "/uav1/camera" + std::to_string(camera) + "/image_raw"; }

static void walk(ros::Publisher publisher, Source source, const Task &task) {
    std::vector<uint8_t> captured(task.frame_bytes());
    while (true) {
        source.expose(captured.data());
        auto image = boost::make_shared<sensor_msgs::Image>();
        sensor_msgs::fillImage(*image, sensor_msgs::image_encodings::MONO8, task.height, task.width, task.width, captured.data());
        publisher.publish(image);
    }
}

static void start_cameras(const Task &task, ros::NodeHandle &node) {
    for (auto &source : Source::all(task)) {
        static size_t camera = 0;
        auto publisher = node.advertise<sensor_msgs::Image>(topic(camera++), 1);
        std::thread(walk, publisher, source, std::cref(task)).detach();
    }
}

static void produce(const Task &task, ros::NodeHandle &node) {
    start_cameras(task, node);
    ros::AsyncSpinner spinner(1);
    spinner.start();
    wait_for_end();
}

static void consume(const Task &task, ros::NodeHandle &node) {
    Window window(task);
    std::vector<ros::Subscriber> subscribers;
    for (size_t camera = 0; camera < task.cameras; camera++) {
        boost::function<void(const sensor_msgs::ImageConstPtr &)> received =
            [&window, camera](const sensor_msgs::ImageConstPtr &image) { window.received(camera, image->data.data()); };
        subscribers.push_back(node.subscribe<sensor_msgs::Image>(topic(camera), 1, received));
    }
    ros::AsyncSpinner spinner(task.cameras);
    spinner.start();
    window.conduct();
}

int main(int count, char **words) {
    Task task(count, words);
    ros::init(count, words, task.way, ros::init_options::NoSigintHandler | ros::init_options::NoRosout);
    ros::NodeHandle node;
    if (task.way == "produce") {
        produce(task, node);
    } else if (task.way == "consume") {
        consume(task, node);
    } else if (task.way == "share") {
        start_cameras(task, node);
        consume(task, node);
    } else {
        fail(task.way + ": produce, consume or share");
    }
    ros::shutdown();
    // Threads that publish end with the program.
    _exit(0);
}
