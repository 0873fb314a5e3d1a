// SPDX-License-Identifier: BSD-3-Clause
#ifndef UVCAM_ROS_REPORT_HPP
#define UVCAM_ROS_REPORT_HPP

#include <diagnostic_updater/diagnostic_updater.h>
#include <diagnostic_updater/update_functions.h>

#include <mutex>
#include <optional>
#include <string>

#include <uvcam.hpp>

#include "parameters.hpp"

namespace uvcam_ros {

/// What /diagnostics says of a camera. One thread tells of frames, another one publishes.
class Report {
  public:
    Report(const ros::NodeHandle &node, const ros::NodeHandle &private_node, const std::string &name,
           const Parameters &parameters);

    /// A frame was published, or refused as it has no mask.
    void frame(const uvcam::Frame &frame, bool is_refused);
    /// A black frame was published in place of a lost one.
    void black();
    /// What the subscriber has counted; nothing has failed.
    void counters(const uvcam::Counters &counters);
    void failure(const std::string &text);

    /// Publishes when it is time to. To be called several times a second.
    void update();

  private:
    using Status = diagnostic_updater::DiagnosticStatusWrapper;

    struct Tally {
        uvcam::Counters counters = {};
        std::uint64_t published = 0, refused = 0, black = 0;
        std::uint64_t period_ns = 0;
        std::optional<uvcam::MaskId> mask_id;
        bool is_refused = false;
        std::string failure;
    };

    void frames(Status &status);
    void driver(Status &status);
    void look_at_health();

    const Parameters &parameters_;
    std::mutex mutex_;
    Tally tally_;
    // Of the thread that publishes alone.
    std::uint64_t lost_told_ = 0;
    double rate_hz_ = 0;
    std::optional<uvcam::HealthReader> reader_;
    std::optional<uvcam::Health> health_;
    /// CLOCK_MONOTONIC in ns of the last record, or of the first look for one.
    std::uint64_t sign_of_life_ns_ = 0;
    diagnostic_updater::FrequencyStatus frequency_;
    diagnostic_updater::Updater updater_;
};

/// 32 hexadecimal digits, as uvcam prints it.
std::string hexadecimal(const uvcam::MaskId &id);

} // namespace uvcam_ros

#endif // UVCAM_ROS_REPORT_HPP
