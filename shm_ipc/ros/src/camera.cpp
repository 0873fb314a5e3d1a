// SPDX-License-Identifier: BSD-3-Clause
#include "camera.hpp"

#include <boost/make_shared.hpp>

#include <algorithm>

#include "master.hpp"

namespace uvcam_ros {
namespace {

using namespace std::chrono_literals;

/// Longest sleep before a look whether this is to end.
constexpr auto NAP = 100ms;
/// Between attempts at what has failed.
constexpr auto RETRY = 1s;
/// Between looks at diagnostics, which have a period of their own.
constexpr auto LOOK = 200ms;
/// Looks at diagnostics for one at the master.
constexpr int LOOKS_AT_MASTER = 5;
/// What black frames may delay the frame after them, at most.
constexpr std::uint64_t LONGEST_DELAY_NS = 100'000'000;

} // namespace

Camera::Camera(const ros::NodeHandle &node, const ros::NodeHandle &private_node, const std::string &name)
    : name_(name), parameters_(read_parameters(private_node, name)),
      calibration_(private_node, parameters_.camera_name, parameters_.calib_url),
      publisher_(image_transport::ImageTransport(private_node)
                     .advertiseCamera("image_raw", parameters_.queue_size)),
      mask_publisher_(ros::NodeHandle(node).advertise<sensor_msgs::Image>(
          ros::names::append(ros::names::parentNamespace(publisher_.getTopic()), "mask"), 1, true)),
      report_(node, private_node, name, parameters_) {
    // Here, as it reads a file.
    calibration_.isCalibrated();
    frames_ = std::thread([this] { publish_frames(); });
    care_ = std::thread([this] { look_after(); });
}

Camera::~Camera() {
    {
        std::lock_guard lock(mutex_);
        is_ending_ = true;
    }
    ending_.notify_all();
    frames_.join();
    care_.join();
}

void Camera::publish_frames() {
    std::string last_failure;
    while (!is_ending()) {
        try {
            if (!subscriber_) {
                subscriber_.emplace(parameters_.camera, parameters_.settings);
                subscriber_->set_wakeup(parameters_.wakeup);
            }
            subscriber_->wait(NAP);
            while (auto frame = is_ending() ? std::nullopt : subscriber_->receive())
                take(*frame);
            report_.counters(subscriber_->counters());
            last_failure.clear();
        } catch (const std::exception &error) {
            report_.failure(error.what());
            if (last_failure != error.what())
                ROS_ERROR("%s: %s", name_.c_str(), error.what());
            last_failure = error.what();
            pause(RETRY);
        }
    }
}

void Camera::look_after() {
    for (int looks = 0; pause(LOOK); ++looks) {
        report_.update();
        if (looks % LOOKS_AT_MASTER == 0)
            register_again_if_unknown(publisher_.getTopic());
    }
}

void Camera::take(const uvcam::Frame &frame) {
    if (!frame.is_masked() && !parameters_.allow_unmasked)
        return refuse(frame);
    is_refusing_ = false;
    fill(frame);
    publish(images_.copy_of(frame), frame.header().mid_exposure_realtime_ns);
    last_mid_exposure_ns_ = frame.header().mid_exposure_monotonic_ns;
    report_.frame(frame, false);
    publish_mask(frame);
}

void Camera::refuse(const uvcam::Frame &frame) {
    if (!is_refusing_)
        ROS_ERROR("%s: frames of \"%s\" are not masked and show the own airframe: they are not published. Let the "
                  "driver apply a mask, or set allow_unmasked.",
                  name_.c_str(), parameters_.camera.c_str());
    is_refusing_ = true;
    last_mid_exposure_ns_.reset();
    report_.frame(frame, true);
}

void Camera::fill(const uvcam::Frame &frame) {
    const std::uint64_t lost = frame.lost_before();
    // Between two epochs, time passes of which nobody knows how many frames it was.
    if (lost == 0 || lost > parameters_.fill_lost || frame.epoch_changed() || !last_mid_exposure_ns_)
        return;
    const uvcam::Header &header = frame.header();
    // On the clock that does not step.
    if (header.mid_exposure_monotonic_ns <= *last_mid_exposure_ns_)
        return;
    const std::uint64_t step_ns = (header.mid_exposure_monotonic_ns - *last_mid_exposure_ns_) / (lost + 1);
    // A subscriber whose queue holds one message gets each only where it has the time to take it.
    const auto apart = std::chrono::nanoseconds(std::min(header.frame_period_ns, LONGEST_DELAY_NS) / (lost + 1));
    for (std::uint64_t left = lost; left > 0; --left) {
        publish(images_.black_like(frame), header.mid_exposure_realtime_ns - left * step_ns);
        report_.black();
        if (!pause(apart))
            return;
    }
}

void Camera::publish(const sensor_msgs::ImagePtr &image, std::uint64_t stamp_ns) {
    image->header.stamp.fromNSec(stamp_ns);
    image->header.frame_id = parameters_.frame_id;
    publisher_.publish(image, info_for(*image));
}

sensor_msgs::CameraInfoPtr Camera::info_for(const sensor_msgs::Image &image) {
    auto info = boost::make_shared<sensor_msgs::CameraInfo>(calibration_.getCameraInfo());
    if (info->width != image.width || info->height != image.height) {
        if (info->width != 0)
            ROS_WARN_THROTTLE(60, "%s: the calibration is for %u x %u px, frames have %u x %u: it is not published.",
                              name_.c_str(), info->width, info->height, image.width, image.height);
        *info = sensor_msgs::CameraInfo();
        info->width = image.width;
        info->height = image.height;
    }
    info->header = image.header;
    return info;
}

void Camera::publish_mask(const uvcam::Frame &frame) {
    if ((frame.header().flags & (UVCAM_FLAG_MASKED | UVCAM_FLAG_MASK_ATTACHED)) == 0)
        return;
    if (mask_id_ != frame.mask_id()) {
        mask_id_ = frame.mask_id();
        mask_since_ns_ = frame.header().mid_exposure_realtime_ns;
        is_mask_published_ = false;
    }
    if (is_mask_published_)
        return;
    const auto mask = subscriber_->try_mask_of(frame);
    if (!mask) {
        // The next frame asks again.
        if (mask.error().status() != UVCAM_ERROR_MASK_PENDING)
            ROS_ERROR_THROTTLE(60, "%s: no mask image: %s", name_.c_str(), mask.error().what());
        return;
    }
    if (!*mask)
        return;
    const auto image = image_of(**mask);
    image->header.stamp.fromNSec(mask_since_ns_);
    image->header.frame_id = parameters_.frame_id;
    mask_publisher_.publish(image);
    is_mask_published_ = true;
}

bool Camera::is_ending() {
    std::lock_guard lock(mutex_);
    return is_ending_;
}

bool Camera::pause(std::chrono::nanoseconds time) {
    std::unique_lock lock(mutex_);
    return !ending_.wait_for(lock, time, [this] { return is_ending_; });
}

} // namespace uvcam_ros
