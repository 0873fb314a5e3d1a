// SPDX-License-Identifier: BSD-3-Clause
#ifndef UVCAM_ROS_MASTER_HPP
#define UVCAM_ROS_MASTER_HPP

#include <string>

namespace uvcam_ros {

/// Registers what this process publishes at a master that does not know `topic`, as one that was started anew. Connections that exist are
/// left alone: they need no master. Where no master answers, does nothing.
void register_again_if_unknown(const std::string &topic);

} // namespace uvcam_ros

#endif // UVCAM_ROS_MASTER_HPP
