// SPDX-License-Identifier: BSD-3-Clause
#include "report.hpp"

#include <time.h>

#include <algorithm>

namespace uvcam_ros {
namespace {

using Level = diagnostic_msgs::DiagnosticStatus;

/// A record that is older speaks of a driver that is gone or stuck.
constexpr std::uint64_t OLD_NS = 3'000'000'000;

std::uint64_t monotonic_ns() {
    timespec now = {};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return static_cast<std::uint64_t>(now.tv_sec) * 1'000'000'000 + static_cast<std::uint64_t>(now.tv_nsec);
}

} // namespace

std::string hexadecimal(const uvcam::MaskId &id) {
    static const char DIGITS[] = "0123456789abcdef";
    std::string text;
    for (const std::uint8_t byte : id)
        text += {DIGITS[byte >> 4], DIGITS[byte & 15]};
    return text;
}

Report::Report(const ros::NodeHandle &node, const ros::NodeHandle &private_node, const std::string &name,
               const Parameters &parameters)
    : parameters_(parameters), frequency_({&rate_hz_, &rate_hz_, 0.1, 5}, "rate"),
      updater_(node, private_node, name) {
    updater_.setHardwareID(parameters.camera);
    updater_.add(frequency_);
    updater_.add("frames", this, &Report::frames);
    updater_.add("driver", this, &Report::driver);
}

void Report::frame(const uvcam::Frame &frame, bool is_refused) {
    if (!is_refused)
        frequency_.tick();
    std::lock_guard lock(mutex_);
    ++(is_refused ? tally_.refused : tally_.published);
    tally_.is_refused = is_refused;
    tally_.period_ns = frame.header().frame_period_ns;
    tally_.mask_id = frame.is_masked() ? std::optional(frame.mask_id()) : std::nullopt;
}

void Report::black() {
    std::lock_guard lock(mutex_);
    ++tally_.black;
}

void Report::counters(const uvcam::Counters &counters) {
    std::lock_guard lock(mutex_);
    tally_.counters = counters;
    tally_.failure.clear();
}

void Report::failure(const std::string &text) {
    std::lock_guard lock(mutex_);
    tally_.failure = text;
}

void Report::update() {
    {
        std::lock_guard lock(mutex_);
        rate_hz_ = tally_.period_ns == 0 ? 0 : 1e9 / static_cast<double>(tally_.period_ns);
    }
    updater_.update();
}

void Report::frames(Status &status) {
    std::unique_lock lock(mutex_);
    const Tally tally = tally_;
    lock.unlock();
    const std::uint64_t lost = tally.counters.lost - lost_told_;
    lost_told_ = tally.counters.lost;
    if (!tally.failure.empty())
        status.summary(Level::ERROR, tally.failure);
    else if (tally.counters.frames == 0)
        status.summary(Level::ERROR, tally.counters.connected ? "no frame yet" : "no driver runs yet");
    else if (tally.is_refused)
        status.summary(Level::ERROR,
                       "not published: frames are not masked and show the own airframe; allow_unmasked publishes them");
    else if (lost > 0)
        status.summary(Level::WARN, std::to_string(lost) + " lost since the last report");
    else
        status.summary(Level::OK, "none lost since the last report");
    status.add("published", tally.published);
    status.add("lost", tally.counters.lost);
    status.add("black in place of lost", tally.black);
    status.add("refused", tally.refused);
    status.add("rejected", tally.counters.rejected);
    status.add("epochs", tally.counters.epochs);
    status.add("mask", tally.mask_id ? hexadecimal(*tally.mask_id) : "none");
}

void Report::driver(Status &status) {
    try {
        look_at_health();
    } catch (const uvcam::Error &error) {
        status.summary(Level::ERROR, error.what());
        return;
    }
    if (!health_) {
        status.summary(Level::ERROR, "no driver runs");
        return;
    }
    const bool is_streaming = health_->state == UVCAM_STATE_STREAMING;
    status.summary(is_streaming ? Level::OK : Level::ERROR, health_->state_text);
    if (!is_streaming && health_->cause != UVCAM_CAUSE_NONE)
        status.mergeSummary(Level::ERROR, health_->last_error);
    status.add("state", health_->state_text);
    status.add("cause", health_->cause_text);
    status.add("last error", health_->last_error);
    status.add("rate (Hz)", health_->frame_rate);
    status.add("published", health_->published);
    status.add("lost", health_->lost);
    status.add("incomplete", health_->incomplete);
    status.add("failures", health_->failures);
    status.add("temperature (C)", health_->temperature_c);
    uvcam::MaskId mask_id;
    std::copy(std::begin(health_->mask_id), std::end(health_->mask_id), mask_id.begin());
    status.add("mask", hexadecimal(mask_id));
}

void Report::look_at_health() {
    const std::uint64_t now_ns = monotonic_ns();
    if (!reader_) {
        reader_ = uvcam::HealthReader::open(parameters_.camera, parameters_.settings);
        sign_of_life_ns_ = now_ns;
    }
    if (!reader_)
        return;
    if (const auto newer = reader_->read(std::chrono::milliseconds(0))) {
        health_ = newer;
        sign_of_life_ns_ = newer->written_monotonic_ns;
    }
    // What was written after the clock was read is not old.
    if (now_ns > sign_of_life_ns_ && now_ns - sign_of_life_ns_ > OLD_NS) {
        health_.reset();
        reader_.reset();
    }
}

} // namespace uvcam_ros
