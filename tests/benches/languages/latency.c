/* latency CAMERA PREFIX ROOT_PATH FRAMES: a line for each frame, nanoseconds from the send until it was there. */
#define _POSIX_C_SOURCE 200809L
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <uvcam.h>

int main(int argc, char **argv)
{
    if (argc != 5)
        return 2;
    uvcam_settings settings = {argv[2], argv[3]};
    size_t frames = strtoul(argv[4], NULL, 10), count = 0;
    uint64_t *latencies = calloc(frames, sizeof *latencies);
    uvcam_subscriber *subscriber;
    uvcam_status status = latencies == NULL ? UVCAM_ERROR_NO_ROOM : uvcam_open(argv[1], &settings, &subscriber);
    while (status >= 0 && count < frames) {
        status = uvcam_wait(subscriber, 1000);
        uvcam_frame *frame;
        while (count < frames && (status = uvcam_receive(subscriber, &frame)) == UVCAM_OK) {
            uvcam_frame_view view;
            uvcam_frame_read(frame, &view);
            struct timespec now;
            clock_gettime(CLOCK_MONOTONIC, &now);
            latencies[count++] = (uint64_t)now.tv_sec * 1000000000 + (uint64_t)now.tv_nsec - view.header->send_monotonic_ns;
            uvcam_frame_release(frame);
        }
    }
    if (status < 0)
        fprintf(stderr, "%s\n", uvcam_error_text());
    for (size_t at = 0; at < count; ++at)
        printf("%" PRIu64 "\n", latencies[at]);
    free(latencies);
    return status < 0;
}
