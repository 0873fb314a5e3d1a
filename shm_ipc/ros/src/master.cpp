// SPDX-License-Identifier: BSD-3-Clause
#include "master.hpp"

#include <ros/console.h>
#include <ros/master.h>
#include <ros/publication.h>
#include <ros/this_node.h>
#include <ros/topic_manager.h>
#include <ros/xmlrpc_manager.h>

namespace uvcam_ros {
namespace {

/// Asks the master; does not wait for one.
bool ask(const std::string &method, const XmlRpc::XmlRpcValue &request, XmlRpc::XmlRpcValue &answer) {
    XmlRpc::XmlRpcValue response;
    return ros::master::execute(method, request, response, answer, false);
}

/// Whether somebody publishes `topic`; also true where no master answers.
bool is_known(const std::string &topic) {
    XmlRpc::XmlRpcValue request, topics;
    request[0] = ros::this_node::getName();
    request[1] = "";
    if (!ask("getPublishedTopics", request, topics) || topics.getType() != XmlRpc::XmlRpcValue::TypeArray)
        return true;
    for (int at = 0; at < topics.size(); ++at)
        if (std::string(topics[at][0]) == topic)
            return true;
    return false;
}

} // namespace

void register_again_if_unknown(const std::string &topic) {
    if (is_known(topic))
        return;
    ROS_WARN("The ROS master does not know %s: this process registers all that it publishes.", topic.c_str());
    ros::V_string advertised;
    ros::this_node::getAdvertisedTopics(advertised);
    for (const std::string &mine : advertised) {
        const auto publication = ros::TopicManager::instance()->lookupPublication(mine);
        if (!publication)
            continue;
        XmlRpc::XmlRpcValue request, subscribers;
        request[0] = ros::this_node::getName();
        request[1] = mine;
        request[2] = publication->getDataType();
        request[3] = ros::XMLRPCManager::instance()->getServerURI();
        ask("registerPublisher", request, subscribers);
    }
}

} // namespace uvcam_ros
