// SPDX-License-Identifier: BSD-3-Clause
#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include <memory>

#include "camera.hpp"

namespace uvcam_ros {

/// A camera in a nodelet manager, whose other nodelets share its messages.
class CameraNodelet : public nodelet::Nodelet {
  private:
    void onInit() override try {
        camera_ = std::make_unique<Camera>(getNodeHandle(), getPrivateNodeHandle(), getName());
    } catch (const std::exception &error) {
        // The manager says that it failed, and not why.
        NODELET_FATAL("%s: %s", getName().c_str(), error.what());
        throw;
    }

    std::unique_ptr<Camera> camera_;
};

} // namespace uvcam_ros

PLUGINLIB_EXPORT_CLASS(uvcam_ros::CameraNodelet, nodelet::Nodelet)
