// SPDX-License-Identifier: BSD-3-Clause
#ifndef UVCAM_ROS_CAMERA_HPP
#define UVCAM_ROS_CAMERA_HPP

#include <camera_info_manager/camera_info_manager.h>
#include <image_transport/image_transport.h>
#include <ros/ros.h>

#include <condition_variable>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include <uvcam.hpp>

#include "images.hpp"
#include "parameters.hpp"
#include "report.hpp"

namespace uvcam_ros {

/// Publishes one of uvcam's cameras: image_raw, camera_info, mask and diagnostics. The driver, and the ROS master, may come later, go, and
/// come back.
///
/// One thread waits for frames and publishes them. Another one does what may take long: diagnostics, and talking to the master.
class Camera {
  public:
    /// `name` is that of the node or nodelet. Throws std::invalid_argument where a parameter cannot be.
    Camera(const ros::NodeHandle &node, const ros::NodeHandle &private_node, const std::string &name);
    /// Ends both threads.
    ~Camera();

    Camera(const Camera &) = delete;
    Camera &operator=(const Camera &) = delete;

  private:
    void publish_frames();
    void look_after();
    void take(const uvcam::Frame &frame);
    void refuse(const uvcam::Frame &frame);
    void fill(const uvcam::Frame &frame);
    void publish(const sensor_msgs::ImagePtr &image, std::uint64_t stamp_ns);
    sensor_msgs::CameraInfoPtr info_for(const sensor_msgs::Image &image);
    void publish_mask(const uvcam::Frame &frame);
    bool is_ending();
    /// Waits; returns whether this is not to end meanwhile.
    bool pause(std::chrono::nanoseconds time);

    const std::string name_;
    const Parameters parameters_;
    camera_info_manager::CameraInfoManager calibration_;
    image_transport::CameraPublisher publisher_;
    ros::Publisher mask_publisher_;
    Report report_;
    // Of the thread that publishes frames alone, down to the next remark.
    std::optional<uvcam::Subscriber> subscriber_;
    Images images_;
    /// Of the last frame, where it was published.
    std::optional<std::uint64_t> last_mid_exposure_ns_;
    /// The mask that frames name, and the stamp of the first of them.
    std::optional<uvcam::MaskId> mask_id_;
    std::uint64_t mask_since_ns_ = 0;
    bool is_mask_published_ = false;
    bool is_refusing_ = false;
    // Of all threads.
    std::mutex mutex_;
    std::condition_variable ending_;
    bool is_ending_ = false;
    std::thread frames_, care_;
};

} // namespace uvcam_ros

#endif // UVCAM_ROS_CAMERA_HPP
