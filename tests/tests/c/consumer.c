/* consumer CAMERA PREFIX ROOT_PATH: a line for each frame, until SIGTERM; then the counters. */
#include "consumer.h"

static int fail(void)
{
    fprintf(stderr, "%s\n", uvcam_error_text());
    return 1;
}

int main(int argc, char **argv)
{
    if (argc != 4)
        return 2;
    signal(SIGTERM, end);
    uvcam_settings settings = {argv[2], argv[3]};
    uvcam_subscriber *subscriber;
    if (uvcam_open(argv[1], &settings, &subscriber) != UVCAM_OK)
        return fail();
    while (!is_over) {
        if (uvcam_wait(subscriber, 100) < 0)
            return fail();
        uvcam_frame *frame;
        uvcam_status status;
        while ((status = uvcam_receive(subscriber, &frame)) == UVCAM_OK) {
            uvcam_frame_view view;
            if (uvcam_frame_read(frame, &view) != UVCAM_OK)
                return fail();
            tell(view.header, view.pixels, view.size, view.lost_before, view.epoch_changed);
            if (uvcam_frame_release(frame) != UVCAM_OK)
                return fail();
        }
        if (status < 0)
            return fail();
        fflush(stdout);
    }
    uvcam_counters counters;
    if (uvcam_get_counters(subscriber, &counters) != UVCAM_OK || uvcam_close(subscriber) != UVCAM_OK)
        return fail();
    printf("counters %" PRIu64 " %" PRIu64 " %" PRIu64 " %" PRIu64 " %d\n", counters.frames, counters.lost,
           counters.epochs, counters.rejected, counters.connected);
    return 0;
}
