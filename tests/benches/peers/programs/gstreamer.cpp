// GStreamer: shmsink to shmsrc, masked by the consumer.
//
// Ways: `produce` pushes buffers of a pool through appsrc; `consume` masks in the thread that receives, before any queue.

#include <gst/app/gstappsink.h>
#include <gst/app/gstappsrc.h>
#include <gst/gst.h>

#include <thread>

#include "peer.hpp"

static std::string socket_path(const Task &task, size_t camera) { return task.folder + "/gst" + std::to_string(camera); }

static std::string caps(const Task &task) {
    return "video/x-raw,format=GRAY8,framerate=60/1,width=" + std::to_string(task.width) +
           ",height=" + std::to_string(task.height);
}

static GstElement *parse(const std::string &description) {
    GError *error = nullptr;
    GstElement *pipeline = gst_parse_launch(description.c_str(), &error);
    if (error) fail(error->message);
    return pipeline;
}

static GstBufferPool *pool(const Task &task) {
    GstBufferPool *pool = gst_buffer_pool_new();
    GstStructure *config = gst_buffer_pool_get_config(pool);
    gst_buffer_pool_config_set_params(config, nullptr, guint(task.frame_bytes()), 4, 0);
    if (!gst_buffer_pool_set_config(pool, config) || !gst_buffer_pool_set_active(pool, TRUE)) fail("no buffer pool");
    return pool;
}

static void walk(GstAppSrc *appsrc, GstBufferPool *pool, Source source, const std::atomic<bool> &over) {
    while (!over) {
        GstBuffer *buffer;
        if (gst_buffer_pool_acquire_buffer(pool, &buffer, nullptr) != GST_FLOW_OK) fail("no free buffer");
        GstMapInfo map;
        gst_buffer_map(buffer, &map, GST_MAP_WRITE);
        source.expose(map.data);
        gst_buffer_unmap(buffer, &map);
        if (gst_app_src_push_buffer(appsrc, buffer) != GST_FLOW_OK) fail("a frame cannot be pushed");
    }
}

static void produce(const Task &task) {
    std::vector<GstElement *> pipelines;
    std::vector<std::thread> threads;
    std::atomic<bool> over{false};
    for (auto &source : Source::all(task)) {
        size_t shm_bytes = 16 * task.frame_bytes();
        GstElement *pipeline =
            parse("appsrc name=source is-live=true format=time caps=" + caps(task) +
                  " ! shmsink wait-for-connection=false sync=false shm-size=" + std::to_string(shm_bytes) +
                  " socket-path=" + socket_path(task, pipelines.size()));
        gst_element_set_state(pipeline, GST_STATE_PLAYING);
        auto appsrc = GST_APP_SRC(gst_bin_get_by_name(GST_BIN(pipeline), "source"));
        pipelines.push_back(pipeline);
        threads.emplace_back(walk, appsrc, pool(task), source, std::cref(over));
    }
    wait_for_end();
    over = true;
    for (auto &thread : threads) thread.join();
    // Takes the shared memory away.
    for (auto pipeline : pipelines) gst_element_set_state(pipeline, GST_STATE_NULL);
}

struct Receiver {
    Window &window;
    size_t camera;
};

static GstFlowReturn received(GstAppSink *appsink, gpointer data) {
    auto receiver = static_cast<Receiver *>(data);
    GstSample *sample = gst_app_sink_pull_sample(appsink);
    if (!sample) return GST_FLOW_EOS;
    GstMapInfo map;
    gst_buffer_map(gst_sample_get_buffer(sample), &map, GST_MAP_READ);
    receiver->window.received(receiver->camera, map.data);
    gst_buffer_unmap(gst_sample_get_buffer(sample), &map);
    gst_sample_unref(sample);
    return GST_FLOW_OK;
}

static void consume(const Task &task) {
    Window window(task);
    std::vector<GstElement *> pipelines;
    for (size_t camera = 0; camera < task.cameras; camera++) {
        // A source that finds no socket fails.
        while (access(socket_path(task, camera).c_str(), F_OK) != 0) sleep_s(0.01);
        GstElement *pipeline = parse("shmsrc is-live=true socket-path=" + socket_path(task, camera) + " ! " + caps(task) +
                                     " ! appsink name=sink sync=false");
        auto appsink = GST_APP_SINK(gst_bin_get_by_name(GST_BIN(pipeline), "sink"));
        GstAppSinkCallbacks callbacks{};
        callbacks.new_sample = received;
        gst_app_sink_set_callbacks(appsink, &callbacks, new Receiver{window, camera}, nullptr);
        while (gst_element_set_state(pipeline, GST_STATE_PLAYING) == GST_STATE_CHANGE_FAILURE) {
            gst_element_set_state(pipeline, GST_STATE_NULL);
            sleep_s(0.01);
        }
        pipelines.push_back(pipeline);
    }
    window.conduct();
    for (auto pipeline : pipelines) gst_element_set_state(pipeline, GST_STATE_NULL);
}

int main(int count, char **words) {
    Task task(count, words);
    gst_init(nullptr, nullptr);
    if (task.way == "produce") {
        produce(task);
    } else if (task.way == "consume") {
        consume(task);
    } else {
        fail(task.way + ": produce or consume");
    }
}
