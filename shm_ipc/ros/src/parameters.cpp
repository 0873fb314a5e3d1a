// SPDX-License-Identifier: BSD-3-Clause
#include "parameters.hpp"

#include <ros/console.h>

#include <algorithm>
#include <set>
#include <stdexcept>

namespace uvcam_ros {
namespace {

const char *kind(const std::string &) { return "a string (type=\"string\")"; }
const char *kind(int) { return "an integer"; }
const char *kind(bool) { return "true or false"; }

/// Reads parameters, and knows which.
class Reader {
  public:
    explicit Reader(const ros::NodeHandle &node) : node_(node) {}

    template <class T> T value(const std::string &key, T otherwise) {
        known_.insert(key);
        T value;
        if (node_.getParam(key, value))
            return value;
        if (node_.hasParam(key))
            throw std::invalid_argument(node_.resolveName(key) + " is not " + kind(otherwise));
        return otherwise;
    }

    std::uint32_t number(const std::string &key, int otherwise, int least, int most) {
        const int number = value(key, otherwise);
        if (number < least || number > most)
            throw std::invalid_argument(node_.resolveName(key) + " = " + std::to_string(number) +
                                        " is not from " + std::to_string(least) + " to " + std::to_string(most));
        return static_cast<std::uint32_t>(number);
    }

    uvcam_wakeup wakeup() {
        const std::string text = value<std::string>("wakeup", "futex");
        if (text == "futex")
            return UVCAM_WAKEUP_FUTEX;
        if (text == "predictive")
            return UVCAM_WAKEUP_PREDICTIVE;
        if (text == "event")
            return UVCAM_WAKEUP_EVENT;
        throw std::invalid_argument(node_.resolveName("wakeup") + " = \"" + text +
                                    "\" is not \"futex\", \"predictive\" or \"event\"");
    }

    /// Parameters that nobody reads, as those that a launch file had for another camera driver.
    std::string unread() const {
        const std::string place = node_.getNamespace() + "/";
        std::vector<std::string> names;
        node_.getParamNames(names);
        std::string unread;
        for (const std::string &name : names) {
            if (name.rfind(place, 0) != 0)
                continue;
            const std::string key = name.substr(place.size());
            if (key.find('/') == std::string::npos && known_.count(key) == 0)
                unread += (unread.empty() ? "" : ", ") + key;
        }
        return unread;
    }

  private:
    const ros::NodeHandle &node_;
    /// diagnostic_updater reads that one.
    std::set<std::string> known_ = {"diagnostic_period"};
};

/// What camera_info_manager takes as a name: letters, digits and "_".
std::string plain(std::string name) {
    std::replace(name.begin(), name.end(), '-', '_');
    return name;
}

} // namespace

Parameters read_parameters(const ros::NodeHandle &node, const std::string &name) {
    Reader reader(node);
    Parameters read;
    read.camera = reader.value("camera", name.substr(name.rfind('/') + 1));
    read.settings.prefix = reader.value<std::string>("prefix", "");
    read.settings.root_path = reader.value<std::string>("root_path", "");
    read.wakeup = reader.wakeup();
    read.frame_id = reader.value("frame_id", read.camera);
    read.camera_name = reader.value("camera_name", plain(read.camera));
    read.calib_url = reader.value<std::string>("calib_url", "");
    read.queue_size = reader.number("queue_size", 10, 1, 10000);
    read.fill_lost = reader.number("fill_lost", 0, 0, 60);
    read.allow_unmasked = reader.value("allow_unmasked", false);
    const std::string unread = reader.unread();
    if (!unread.empty())
        ROS_WARN("%s: not read here: %s. The camera's settings are those of uvcam's configuration.",
                 name.c_str(), unread.c_str());
    return read;
}

} // namespace uvcam_ros
