/* Tells once a second how many frames came and how many were lost.
 *
 *     cc rate_and_loss.c $(pkg-config --cflags --libs uvcam) -o rate_and_loss
 *     ./rate_and_loss CAMERA [PREFIX ROOT_PATH]
 */
#include <inttypes.h>
#include <stdio.h>
#include <uvcam.h>

static int fail(void)
{
    fprintf(stderr, "%s\n", uvcam_error_text());
    return 1;
}

int main(int argc, char **argv)
{
    if (argc != 2 && argc != 4) {
        fprintf(stderr, "usage: %s CAMERA [PREFIX ROOT_PATH]\n", argv[0]);
        return 2;
    }
    uvcam_settings settings = {argc == 4 ? argv[2] : NULL, argc == 4 ? argv[3] : NULL};
    uvcam_subscriber *subscriber;
    if (uvcam_open(argv[1], &settings, &subscriber) != UVCAM_OK)
        return fail();

    uint64_t frames = 0, lost = 0, begin_ns = 0;
    uvcam_status status;
    while ((status = uvcam_wait(subscriber, 1000)) >= 0) {
        if (status == UVCAM_NONE)
            printf("no frame for a second\n");
        uvcam_frame *frame;
        while ((status = uvcam_receive(subscriber, &frame)) == UVCAM_OK) {
            uvcam_frame_view view;
            if (uvcam_frame_read(frame, &view) != UVCAM_OK)
                return fail();
            if (view.epoch_changed)
                printf("the driver or its camera started anew\n");
            uint64_t now_ns = view.header->send_monotonic_ns;
            frames += 1;
            lost += view.lost_before;
            if (begin_ns == 0)
                begin_ns = now_ns;
            if (now_ns - begin_ns >= 1000000000) {
                printf("%.2f frames a second, %" PRIu64 " lost\n", frames * 1e9 / (now_ns - begin_ns), lost);
                fflush(stdout);
                frames = lost = 0;
                begin_ns = now_ns;
            }
            uvcam_frame_release(frame);
        }
        if (status < 0)
            break;
    }
    return fail();
}
