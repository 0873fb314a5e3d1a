/* misuse CAMERA PREFIX ROOT_PATH: everything that is not allowed, beside a running driver. Each is an error, and what is allowed still works. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <pthread.h>
#include <time.h>

#include "check.h"

static const char *camera;
static uvcam_settings settings;

static uvcam_subscriber *opened(const char *name)
{
    uvcam_subscriber *subscriber = NULL;
    CHECK(uvcam_open(name, &settings, &subscriber) == UVCAM_OK);
    CHECK(subscriber != NULL);
    return subscriber;
}

static uvcam_frame *received(uvcam_subscriber *subscriber)
{
    uvcam_frame *frame = NULL;
    uvcam_status status;
    while ((status = uvcam_receive(subscriber, &frame)) == UVCAM_NONE)
        CHECK(uvcam_wait(subscriber, 20000) == UVCAM_OK);
    CHECK(status == UVCAM_OK && frame != NULL);
    return frame;
}

static void null_and_nonsense(void)
{
    uvcam_subscriber *subscriber = (uvcam_subscriber *)&settings;
    CHECK_FAILS(uvcam_open(NULL, &settings, &subscriber), UVCAM_ERROR_ARGUMENT, "NULL is not a camera's name");
    CHECK(subscriber == NULL);
    CHECK_FAILS(uvcam_open(camera, &settings, NULL), UVCAM_ERROR_ARGUMENT, "a place for a subscriber");
    CHECK_FAILS(uvcam_open("no/name", &settings, &subscriber), UVCAM_ERROR_ARGUMENT, "\"no/name\": use 1 to 64");
    CHECK_FAILS(uvcam_open("\xff", &settings, &subscriber), UVCAM_ERROR_ARGUMENT, "use UTF-8");
    uvcam_settings wrong = {"a/b", NULL};
    CHECK_FAILS(uvcam_open(camera, &wrong, &subscriber), UVCAM_ERROR_ARGUMENT, "prefix = \"a/b\": use");
    wrong = (uvcam_settings){NULL, "here"};
    CHECK_FAILS(uvcam_open(camera, &wrong, &subscriber), UVCAM_ERROR_ARGUMENT, "root_path = here: use");
    CHECK_FAILS(uvcam_wait(NULL, 0), UVCAM_ERROR_ARGUMENT, "NULL is not a subscriber");
    CHECK_FAILS(uvcam_frame_release(NULL), UVCAM_ERROR_ARGUMENT, "NULL is not a frame");
    CHECK_FAILS(uvcam_close(NULL), UVCAM_ERROR_ARGUMENT, "NULL is not a subscriber");
    /* What is nobody's handle, and never was. */
    uvcam_frame *frame = (uvcam_frame *)&frame;
    uvcam_frame_view view;
    CHECK_FAILS(uvcam_frame_read(frame, &view), UVCAM_ERROR_HANDLE, "is not a frame");
    CHECK_FAILS(uvcam_frame_release((uvcam_frame *)UINTPTR_MAX), UVCAM_ERROR_HANDLE, "is not a frame");
    CHECK_FAILS(uvcam_wait((uvcam_subscriber *)&settings, 0), UVCAM_ERROR_HANDLE, "is not a subscriber");
}

static void frames(void)
{
    uvcam_subscriber *subscriber = opened(camera);
    CHECK_FAILS(uvcam_receive(subscriber, NULL), UVCAM_ERROR_ARGUMENT, "a place for a frame");
    CHECK_FAILS(uvcam_get_counters(subscriber, NULL), UVCAM_ERROR_ARGUMENT, "a place for counters");
    CHECK_FAILS(uvcam_set_wakeup(subscriber, 3), UVCAM_ERROR_ARGUMENT, "3 is not a wake-up");
    uvcam_frame *frame = received(subscriber);
    uvcam_frame_view view;
    CHECK_FAILS(uvcam_frame_read(frame, NULL), UVCAM_ERROR_ARGUMENT, "a place for a view");
    CHECK(uvcam_frame_read(frame, &view) == UVCAM_OK);
    CHECK(view.size == (size_t)view.header->stride * (view.header->height - 1) + view.row_size);
    /* One kind of handle is not another. */
    CHECK_FAILS(uvcam_close((uvcam_subscriber *)frame), UVCAM_ERROR_HANDLE, "is not a subscriber");
    CHECK_FAILS(uvcam_frame_release((uvcam_frame *)subscriber), UVCAM_ERROR_HANDLE, "is not a frame");
    /* Released twice, and used after that, while another frame has its memory. */
    CHECK(uvcam_frame_release(frame) == UVCAM_OK);
    uvcam_frame *other = received(subscriber);
    CHECK_FAILS(uvcam_frame_release(frame), UVCAM_ERROR_HANDLE, "released before");
    CHECK_FAILS(uvcam_frame_read(frame, &view), UVCAM_ERROR_HANDLE, "released before");
    CHECK(uvcam_frame_read(other, &view) == UVCAM_OK);
    CHECK(uvcam_frame_release(other) == UVCAM_OK);
    CHECK(uvcam_close(subscriber) == UVCAM_OK);
}

static void too_many(void)
{
    uvcam_subscriber *subscriber = opened(camera);
    uvcam_frame *held[65];
    size_t count = 0;
    uvcam_status status = UVCAM_OK;
    while (status >= 0 && count < 65) {
        CHECK(uvcam_wait(subscriber, 20000) == UVCAM_OK);
        status = uvcam_receive(subscriber, &held[count]);
        count += status == UVCAM_OK;
    }
    CHECK(status == UVCAM_ERROR_TOO_MANY_HELD && count == 4 && held[4] == NULL);
    CHECK(strstr(uvcam_error_text(), "holds as many frames as it may") != NULL);
    CHECK(uvcam_frame_release(held[0]) == UVCAM_OK);
    held[0] = received(subscriber);
    /* Frames outlive their subscriber. */
    CHECK(uvcam_close(subscriber) == UVCAM_OK);
    CHECK_FAILS(uvcam_wait(subscriber, 0), UVCAM_ERROR_HANDLE, "closed");
    CHECK_FAILS(uvcam_receive(subscriber, &held[4]), UVCAM_ERROR_HANDLE, "closed");
    CHECK_FAILS(uvcam_close(subscriber), UVCAM_ERROR_HANDLE, "closed");
    for (size_t at = 0; at < count; ++at) {
        uvcam_frame_view view;
        CHECK(uvcam_frame_read(held[at], &view) == UVCAM_OK);
        unsigned sum = 0;
        for (size_t byte = 0; byte < view.size; byte += 997)
            sum += view.pixels[byte];
        CHECK(sum > 0);
        CHECK(uvcam_frame_release(held[at]) == UVCAM_OK);
    }
}

static void *wait_in_vain(void *subscriber)
{
    CHECK(strcmp(uvcam_error_text(), "") == 0);
    CHECK(uvcam_wait(subscriber, 1000) == UVCAM_NONE);
    return NULL;
}

static void *release(void *frame)
{
    CHECK(uvcam_frame_release(frame) == UVCAM_OK);
    return NULL;
}

static void threads(void)
{
    uvcam_subscriber *subscriber = opened("nobody");
    pthread_t thread;
    CHECK(pthread_create(&thread, NULL, wait_in_vain, subscriber) == 0);
    const struct timespec nap = {0, 1000000};
    while (uvcam_set_wakeup(subscriber, UVCAM_WAKEUP_FUTEX) == UVCAM_OK)
        nanosleep(&nap, NULL);
    uvcam_frame *frame;
    CHECK_FAILS(uvcam_receive(subscriber, &frame), UVCAM_ERROR_BUSY, "another thread is using a subscriber");
    CHECK_FAILS(uvcam_close(subscriber), UVCAM_ERROR_BUSY, "another thread");
    CHECK(pthread_join(thread, NULL) == 0);
    CHECK(uvcam_receive(subscriber, &frame) == UVCAM_NONE && frame == NULL);
    CHECK(uvcam_close(subscriber) == UVCAM_OK);
    /* Received here, released there. */
    subscriber = opened(camera);
    frame = received(subscriber);
    CHECK(pthread_create(&thread, NULL, release, frame) == 0 && pthread_join(thread, NULL) == 0);
    CHECK_FAILS(uvcam_frame_release(frame), UVCAM_ERROR_HANDLE, "released before");
    CHECK(uvcam_close(subscriber) == UVCAM_OK);
}

static void health(void)
{
    uvcam_health_reader *reader = (uvcam_health_reader *)&settings;
    CHECK_FAILS(uvcam_health_open(camera, &settings, NULL), UVCAM_ERROR_ARGUMENT, "a place for a health reader");
    CHECK_FAILS(uvcam_health_open(NULL, &settings, &reader), UVCAM_ERROR_ARGUMENT, "a camera's name");
    CHECK(uvcam_health_open("nobody", &settings, &reader) == UVCAM_NONE && reader == NULL);
    CHECK(uvcam_health_open(camera, &settings, &reader) == UVCAM_OK);
    CHECK_FAILS(uvcam_health_read(reader, 0, NULL), UVCAM_ERROR_ARGUMENT, "a place for a health record");
    uvcam_health health;
    do
        CHECK(uvcam_health_read(reader, 20000, &health) == UVCAM_OK);
    while (health.frame_rate == 0);
    CHECK(health.state == UVCAM_STATE_STREAMING && strcmp(health.state_text, "streaming") == 0);
    CHECK(health.cause == UVCAM_CAUSE_NONE && strcmp(health.cause_text, "none") == 0);
    CHECK(health.published > 0 && health.lost == 0 && health.process_id > 0 && strcmp(health.last_error, "") == 0);
    CHECK(!isnan(health.temperature_c));
    CHECK(uvcam_health_close(reader) == UVCAM_OK);
    CHECK_FAILS(uvcam_health_close(reader), UVCAM_ERROR_HANDLE, "is not a health reader");
    CHECK_FAILS(uvcam_health_read(reader, 0, &health), UVCAM_ERROR_HANDLE, "is not a health reader");
}

int main(int argc, char **argv)
{
    if (argc != 4)
        return 2;
    camera = argv[1];
    settings = (uvcam_settings){argv[2], argv[3]};
    null_and_nonsense();
    frames();
    too_many();
    threads();
    health();
    puts("all refused");
    return 0;
}
