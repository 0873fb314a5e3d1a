/* SPDX-License-Identifier: BSD-3-Clause
 *
 * libuvcam: masked camera frames of uvcam, in the memory that the camera wrote. Generated from shm_ipc/c/src; do not edit.
 *
 *     uvcam_subscriber *left;
 *     if (uvcam_open("left", NULL, &left) != UVCAM_OK)
 *         return fail(uvcam_error_text());
 *     while (uvcam_wait(left, 1000) >= 0) {
 *         uvcam_frame *frame;
 *         while (uvcam_receive(left, &frame) == UVCAM_OK) {
 *             uvcam_frame_view view;
 *             uvcam_frame_read(frame, &view);
 *             detect(view.pixels, view.header->width, view.header->height, view.header->stride);
 *             uvcam_frame_release(frame);
 *         }
 *     }
 *     uvcam_close(left);
 *
 * Handles (uvcam_subscriber, uvcam_frame, uvcam_mask, uvcam_health_reader) are numbers that look like pointers. None is ever used twice, so that one
 * that was closed or released is an error, UVCAM_ERROR_HANDLE, and nothing else.
 *
 * Threads. Every function may be called from every thread, at any time. A subscriber and a health reader are used by one thread at a time,
 * whichever it is; another one that calls meanwhile gets UVCAM_ERROR_BUSY at once, and uvcam_close() does so as well. To read one camera
 * in several threads, open a subscriber in each. Frames and masks are independent of their subscriber and of each other: one thread may
 * receive them, others read them, and any of them release them. Whoever releases one must know that nobody reads it any more. The text of an
 * error belongs to the thread that got the error. After fork(), the child uses no handle of its parent: it opens its own.
 *
 * Pointers that are passed are NULL or point to what they say, as everywhere in C; NULL where it is not allowed is UVCAM_ERROR_ARGUMENT.
 */

#ifndef UVCAM_H
#define UVCAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/**
 * Version of the contract between driver and consumers that this library speaks.
 */
#define UVCAM_CONTRACT_VERSION 2

/**
 * Flag of a frame: a mask was applied, and what it masks is black; `mask_id` tells which.
 */
#define UVCAM_FLAG_MASKED 1

/**
 * Flag of a frame: it was rendered, not taken.
 */
#define UVCAM_FLAG_SIMULATED 2

/**
 * Flag of a frame: it was read from a file.
 */
#define UVCAM_FLAG_REPLAYED 4

/**
 * Flag of a frame: parts of it are missing.
 */
#define UVCAM_FLAG_INCOMPLETE 8

/**
 * Flag of a frame: the device has no clock, and `device_timestamp_ns` says nothing.
 */
#define UVCAM_FLAG_NO_DEVICE_CLOCK 16

/**
 * Flag of a frame: a mask was not applied and travels beside the frame; `mask_id` tells which.
 */
#define UVCAM_FLAG_MASK_ATTACHED 32

/**
 * Pixel format, as PFNC numbers it: 8 bits in one byte.
 */
#define UVCAM_MONO8 17301505

/**
 * Pixel format: 10 bits in two bytes, little-endian, value in the low bits.
 */
#define UVCAM_MONO10 17825795

/**
 * Pixel format: 12 bits in two bytes, little-endian, value in the low bits.
 */
#define UVCAM_MONO12 17825797

/**
 * Pixel format: 16 bits in two bytes, little-endian.
 */
#define UVCAM_MONO16 17825799

/**
 * What came of a call: UVCAM_OK, UVCAM_NONE, or a negative number for an error, of which uvcam_error_text() says more.
 *
 * New errors may come with new versions: treat every negative number as one.
 */
enum uvcam_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Done.
     */
    UVCAM_OK = 0,
    /**
     * Done, and there is nothing: no unread frame, no frame in time, no driver.
     */
    UVCAM_NONE = 1,
    /**
     * An argument that cannot be: NULL, a camera name, a setting.
     */
    UVCAM_ERROR_ARGUMENT = -1,
    /**
     * A handle that was closed or released before, or never given out.
     */
    UVCAM_ERROR_HANDLE = -2,
    /**
     * Another thread is using this handle just now.
     */
    UVCAM_ERROR_BUSY = -3,
    /**
     * The program holds as many frames, or masks, of this subscriber as it may: release one.
     */
    UVCAM_ERROR_TOO_MANY_HELD = -4,
    /**
     * The camera has as many consumers as it can have.
     */
    UVCAM_ERROR_TOO_MANY_CONSUMERS = -5,
    /**
     * The driver, or a file that is needed, belongs to another user.
     */
    UVCAM_ERROR_PERMISSION = -6,
    /**
     * The driver speaks another version of the contract, or a service does not fit.
     */
    UVCAM_ERROR_INCOMPATIBLE = -7,
    /**
     * Shared memory or a limit of the system leaves too little.
     */
    UVCAM_ERROR_NO_ROOM = -8,
    /**
     * Anything else that the system reports.
     */
    UVCAM_ERROR_SYSTEM = -9,
    /**
     * The mask of a frame has not come yet: ask again with the next frame.
     */
    UVCAM_ERROR_MASK_PENDING = -10,
    /**
     * A fault of this library. What it happened to is best closed.
     */
    UVCAM_ERROR_FAULT = -11,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum uvcam_status uvcam_status;
#else
typedef int32_t uvcam_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * How uvcam_wait() waits.
 */
enum uvcam_wakeup
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Sleeps until the driver has sent a frame. The default; costs nothing while it sleeps.
     */
    UVCAM_WAKEUP_FUTEX = 0,
    /**
     * Sleeps until shortly before the next frame is due, then watches for it, for less than 1 % of the frame period on average. The
     * shortest wake-up, for cameras with a steady rate. The calling thread's affinity is without the driver's core while it sleeps.
     */
    UVCAM_WAKEUP_PREDICTIVE = 1,
    /**
     * Sleeps on the camera's iceoryx2 event. Slower to wake, and slower for the driver.
     */
    UVCAM_WAKEUP_EVENT = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum uvcam_wakeup uvcam_wakeup;
#else
typedef uint32_t uvcam_wakeup;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What a camera's driver does with it. More may come with new versions.
 */
enum uvcam_state
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * It has not been opened yet.
     */
    UVCAM_STATE_STARTING = 1,
    /**
     * Frames are published.
     */
    UVCAM_STATE_STREAMING = 2,
    /**
     * Lit frames are collected for a mask; nothing is published.
     */
    UVCAM_STATE_GENERATING = 3,
    /**
     * It failed or is absent, and is tried again.
     */
    UVCAM_STATE_RECONNECTING = 4,
    /**
     * It stays closed until someone changes its mask or the configuration.
     */
    UVCAM_STATE_REFUSED = 5,
    /**
     * The driver has ended.
     */
    UVCAM_STATE_STOPPED = 6,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum uvcam_state uvcam_state;
#else
typedef uint32_t uvcam_state;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Why a camera does not publish, or last did not. More may come with new versions.
 */
enum uvcam_cause
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Nothing ever went wrong.
     */
    UVCAM_CAUSE_NONE = 0,
    /**
     * No such device is connected.
     */
    UVCAM_CAUSE_ABSENT = 1,
    /**
     * The device was there and is gone.
     */
    UVCAM_CAUSE_DISCONNECTED = 2,
    /**
     * The device sends nothing.
     */
    UVCAM_CAUSE_SILENT = 3,
    /**
     * Every frame arrives with a part missing.
     */
    UVCAM_CAUSE_INCOMPLETE = 4,
    /**
     * The device or its transport reported an error.
     */
    UVCAM_CAUSE_DEVICE = 5,
    /**
     * A setting reads back as another value.
     */
    UVCAM_CAUSE_SETTINGS = 6,
    /**
     * The mask cannot fly.
     */
    UVCAM_CAUSE_MASK = 7,
    /**
     * Shared memory cannot be used.
     */
    UVCAM_CAUSE_SHARED_MEMORY = 8,
    /**
     * A call into the device's library does not return.
     */
    UVCAM_CAUSE_STUCK = 9,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum uvcam_cause uvcam_cause;
#else
typedef uint32_t uvcam_cause;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A frame that this program holds: its memory stays as it is until uvcam_frame_release(). It may be used by any thread, and outlives its
 * subscriber.
 */
typedef struct uvcam_frame uvcam_frame;

/**
 * A reader of one camera's health. One thread at a time may use it, whichever: a call meanwhile fails with UVCAM_ERROR_BUSY.
 */
typedef struct uvcam_health_reader uvcam_health_reader;

/**
 * A mask that this program holds, until uvcam_mask_release(). It may be used by any thread, and outlives its frame and its subscriber.
 */
typedef struct uvcam_mask uvcam_mask;

/**
 * A consumer's end of one camera. One thread at a time may use it, whichever: a call meanwhile fails with UVCAM_ERROR_BUSY.
 */
typedef struct uvcam_subscriber uvcam_subscriber;

/**
 * What is to be known of a frame besides its pixels. 192 bytes; the layout is part of the contract, and CONTRACT.md describes it byte by
 * byte.
 */
typedef struct uvcam_frame_header {
    /**
     * "UVCM" in memory.
     */
    uint32_t magic;
    /**
     * UVCAM_CONTRACT_VERSION.
     */
    uint16_t contract_version;
    /**
     * Bytes of this header.
     */
    uint16_t header_size;
    /**
     * Pixels in a row.
     */
    uint32_t width;
    /**
     * Rows.
     */
    uint32_t height;
    /**
     * Bytes from the start of one row to the start of the next.
     */
    uint32_t stride;
    /**
     * UVCAM_MONO8, UVCAM_MONO10, UVCAM_MONO12 or UVCAM_MONO16.
     */
    uint32_t pixel_format;
    /**
     * UVCAM_FLAG_...; bits that have no name here may be set.
     */
    uint32_t flags;
    /**
     * Zero.
     */
    uint32_t reserved_picture;
    /**
     * Identity of the mask that was applied or travels beside the frame; all zero where the camera flies without.
     */
    uint8_t mask_id[16];
    /**
     * Exposure time in us, as read back from the camera.
     */
    double exposure_us;
    /**
     * Gain in dB, as read back from the camera.
     */
    double gain_db;
    /**
     * Identity of an uninterrupted stream: new, and higher, at every start of the driver and every reconnection of the camera.
     */
    uint64_t epoch;
    /**
     * Place among the published frames of this epoch, from 0.
     */
    uint64_t sequence;
    /**
     * The device's own count of this frame in this epoch, from 0.
     */
    uint64_t device_frame_id;
    /**
     * Identity of the count `produced`.
     */
    uint64_t counting;
    /**
     * Frames that the device is known to have produced up to and including this one, published or not.
     */
    uint64_t produced;
    /**
     * Zero.
     */
    uint64_t reserved_order[3];
    /**
     * Time between frames in ns, as read back from the camera.
     */
    uint64_t frame_period_ns;
    /**
     * The device's own clock at this frame, in ns from an arbitrary start.
     */
    uint64_t device_timestamp_ns;
    /**
     * CLOCK_MONOTONIC in ns when the driver had the whole frame.
     */
    uint64_t arrival_monotonic_ns;
    /**
     * CLOCK_MONOTONIC in ns when the frame was sent.
     */
    uint64_t send_monotonic_ns;
    /**
     * CLOCK_MONOTONIC in ns at the middle of the exposure.
     */
    uint64_t mid_exposure_monotonic_ns;
    /**
     * CLOCK_REALTIME in ns at the middle of the exposure.
     */
    uint64_t mid_exposure_realtime_ns;
    /**
     * Half width in ns of the interval around either mid-exposure stamp that holds the true time.
     */
    uint64_t mid_exposure_uncertainty_ns;
    /**
     * Zero.
     */
    uint64_t reserved_time;
} uvcam_frame_header;

/**
 * What there is to see of a frame. All of it is valid until the frame is released.
 */
typedef struct uvcam_frame_view {
    /**
     * The header: a copy that was checked, so that `pixels` reaches as far as it says.
     */
    const struct uvcam_frame_header *header;
    /**
     * The image, in the memory that the driver wrote: row by row from the top, `header->stride` bytes apart. Mapped for reading alone.
     */
    const uint8_t *pixels;
    /**
     * Bytes from the first pixel to the last: header->stride * (header->height - 1) + row_size.
     */
    size_t size;
    /**
     * Bytes of the pixels of a row; where they are fewer than `header->stride`, the rest is padding.
     */
    size_t row_size;
    /**
     * Frames that the device produced since the frame before and that did not reach this consumer, for whatever reason; exact, also
     * across epochs and drivers. 0 for the first frame.
     */
    uint64_t lost_before;
    /**
     * Whether driver or camera started anew since the frame before.
     */
    bool epoch_changed;
} uvcam_frame_view;

/**
 * Where the driver's services live: `prefix` and `root_path` of the table `[ipc]` of its configuration. A member that is NULL stands for
 * its default.
 */
typedef struct uvcam_settings {
    /**
     * Start of the name of every file of shared memory: 1 to 32 letters, digits, "_" or "-". Default: "uvcam_".
     */
    const char *prefix;
    /**
     * Folder of the service files; absolute. Default: "/tmp/uvcam". A driver that runs as a service has "/run/uvcam".
     */
    const char *root_path;
} uvcam_settings;

/**
 * How long frames took through one stage, in ns, since the driver started. Quantiles are upper bounds, at most 3.2 % too high.
 */
typedef struct uvcam_latency {
    /**
     * Frames measured.
     */
    uint64_t count;
    /**
     * Half of the frames took no longer.
     */
    uint64_t p50_ns;
    /**
     * 90 % took no longer.
     */
    uint64_t p90_ns;
    /**
     * 99 % took no longer.
     */
    uint64_t p99_ns;
    /**
     * 99.9 % took no longer.
     */
    uint64_t p999_ns;
    /**
     * The longest.
     */
    uint64_t max_ns;
} uvcam_latency;

/**
 * How a camera is: a record that its driver renews every second, and with every change of state.
 */
typedef struct uvcam_health {
    /**
     * One of uvcam_state.
     */
    uint32_t state;
    /**
     * One of uvcam_cause: what last ended or kept off a stream. It stays when the camera streams again.
     */
    uint32_t cause;
    /**
     * The same two in words, lower case.
     */
    char state_text[16];
    /**
     * The same two in words, lower case.
     */
    char cause_text[16];
    /**
     * CLOCK_MONOTONIC in ns when the record was written. Older than three seconds, it speaks of a driver that is gone or stuck.
     */
    uint64_t written_monotonic_ns;
    /**
     * CLOCK_MONOTONIC in ns since when the state holds.
     */
    uint64_t state_since_monotonic_ns;
    /**
     * CLOCK_MONOTONIC in ns when the process that runs the camera started.
     */
    uint64_t started_monotonic_ns;
    /**
     * Id of the process that runs the camera.
     */
    uint32_t process_id;
    /**
     * Frames published a second, over the last second.
     */
    double frame_rate;
    /**
     * Temperature of the device in degrees Celsius; NaN where it tells none.
     */
    double temperature_c;
    /**
     * Frames sent, since that process started, as all counters.
     */
    uint64_t published;
    /**
     * Frames that the device is known to have produced and no stream published.
     */
    uint64_t lost;
    /**
     * Frames that arrived with a part missing; they are among the lost.
     */
    uint64_t incomplete;
    /**
     * Times that no free slot was there for the camera to fill.
     */
    uint64_t no_free_slot;
    /**
     * Streams begun.
     */
    uint64_t epochs;
    /**
     * Streams, and attempts to open the camera, that ended in an error.
     */
    uint64_t failures;
    /**
     * Memory of that process, shared memory that it touched included, in bytes.
     */
    uint64_t resident_bytes;
    /**
     * Processor time of that process, in ns.
     */
    uint64_t cpu_ns;
    /**
     * Identity of the mask in force; all zero where none is.
     */
    uint8_t mask_id[16];
    /**
     * First 16 bytes of the SHA-256 of the configuration's text.
     */
    uint8_t config_digest[16];
    /**
     * From the whole frame in memory to its mask applied.
     */
    struct uvcam_latency arrival_to_masked;
    /**
     * From the mask applied to the frame sent and sleeping consumers woken.
     */
    struct uvcam_latency masked_to_sent;
    /**
     * Text of the last error, UTF-8; empty where there was none.
     */
    char last_error[257];
} uvcam_health;

/**
 * Horizontal run of masked pixels: columns `start` to `start + length - 1` of row `row`, counted from 0.
 */
typedef struct uvcam_run {
    /**
     * Row, downwards from the top.
     */
    uint32_t row;
    /**
     * First masked column.
     */
    uint32_t start;
    /**
     * Masked pixels, at least 1.
     */
    uint32_t length;
} uvcam_run;

/**
 * What there is to see of a mask. All of it is valid until the mask is released.
 */
typedef struct uvcam_mask_view {
    /**
     * Identity: the `mask_id` of its frames.
     */
    uint8_t mask_id[16];
    /**
     * Pixels in a row, as many as in a frame.
     */
    uint32_t width;
    /**
     * Rows, as many as in a frame.
     */
    uint32_t height;
    /**
     * The image, row by row from the top without padding, one byte a pixel: 0 discard, 255 keep. Grown where that was asked for; else the
     * driver's own memory, mapped for reading alone.
     */
    const uint8_t *pixels;
    /**
     * Bytes of the image: width * height.
     */
    size_t size;
    /**
     * The masked runs in row order, from left to right, not grown.
     */
    const struct uvcam_run *runs;
    /**
     * How many.
     */
    size_t run_count;
    /**
     * Masked pixels, not grown.
     */
    uint64_t masked_px;
    /**
     * Where the mask comes from: a JSON object of texts. No zero byte ends it.
     */
    const char *provenance;
    /**
     * Bytes of it.
     */
    size_t provenance_size;
} uvcam_mask_view;

/**
 * What a subscriber has counted since it was opened.
 */
typedef struct uvcam_counters {
    /**
     * Frames given out, or passed over by uvcam_receive_latest().
     */
    uint64_t frames;
    /**
     * Sum of `lost_before` over all frames.
     */
    uint64_t lost;
    /**
     * Streams seen: 1 with the first frame, one more with each start of the driver and each reconnection of its camera.
     */
    uint64_t epochs;
    /**
     * Frames dropped because their header was not to be trusted.
     */
    uint64_t rejected;
    /**
     * Whether a driver is there, as far as is known.
     */
    bool connected;
} uvcam_counters;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * What the last call of this thread that failed had to say: what is wrong, where, and what mends it. UTF-8; empty where none has failed.
 * Valid until another call of this thread fails, or the thread ends.
 */
const char *uvcam_error_text(void);

/**
 * Shows a frame.
 */
uvcam_status uvcam_frame_read(const struct uvcam_frame *frame, struct uvcam_frame_view *view);

/**
 * Gives a frame's memory back to the driver. What was seen of it is not to be touched any more, by any thread.
 */
uvcam_status uvcam_frame_release(struct uvcam_frame *frame);

/**
 * Finds the driver of a camera: UVCAM_OK, or UVCAM_NONE where none runs. Arguments as those of uvcam_open(); `reader` becomes NULL where
 * there is none.
 */
uvcam_status uvcam_health_open(const char *camera,
                               const struct uvcam_settings *settings,
                               struct uvcam_health_reader **reader);

/**
 * Gives the newest record that has not been read, and waits for it at most `timeout_ms`: UVCAM_OK, or UVCAM_NONE where none came. After
 * three seconds without one, the driver is gone or stuck: close the reader, and open another.
 */
uvcam_status uvcam_health_read(struct uvcam_health_reader *reader,
                               uint32_t timeout_ms,
                               struct uvcam_health *health);

/**
 * Closes a health reader.
 */
uvcam_status uvcam_health_close(struct uvcam_health_reader *reader);

/**
 * Gives the mask of a frame, whichever is in force by now: UVCAM_OK, or UVCAM_NONE where its camera flies without one. Never waits, and
 * costs little while the mask stays the same. `mask` becomes NULL where there is none, and is to be released where there is one.
 *
 * With `grown_by` above 0, masked areas reach as many pixels further to each side, by columns and rows, so that what looks around a pixel
 * by no more than that does not see the edge of a black area.
 *
 * UVCAM_ERROR_MASK_PENDING where the mask has not come yet, for a second or two after the first call and after the driver started anew: go
 * on with the next frame.
 */
uvcam_status uvcam_frame_mask(struct uvcam_subscriber *subscriber,
                              const struct uvcam_frame *frame,
                              uint32_t grown_by,
                              struct uvcam_mask **mask);

/**
 * Shows a mask.
 */
uvcam_status uvcam_mask_read(const struct uvcam_mask *mask, struct uvcam_mask_view *view);

/**
 * Gives a mask's memory back to the driver. What was seen of it is not to be touched any more, by any thread.
 */
uvcam_status uvcam_mask_release(struct uvcam_mask *mask);

/**
 * Prepares to read the frames of a camera. The driver may come later, go, and come back: the subscriber finds it again by itself.
 *
 * `camera` is its name in the driver's configuration. `settings` may be NULL for the defaults. `subscriber` becomes NULL where this fails.
 */
uvcam_status uvcam_open(const char *camera,
                        const struct uvcam_settings *settings,
                        struct uvcam_subscriber **subscriber);

/**
 * Closes a subscriber. Frames that the program holds stay valid until they are released.
 */
uvcam_status uvcam_close(struct uvcam_subscriber *subscriber);

/**
 * Chooses how uvcam_wait() waits: one of uvcam_wakeup.
 */
uvcam_status uvcam_set_wakeup(struct uvcam_subscriber *subscriber, uint32_t wakeup);

/**
 * Waits until a frame may be there, at most `timeout_ms`: UVCAM_OK, or UVCAM_NONE where none came. A signal handler does not end it.
 */
uvcam_status uvcam_wait(struct uvcam_subscriber *subscriber,
                        uint32_t timeout_ms);

/**
 * Gives the oldest unread frame: UVCAM_OK, or UVCAM_NONE where there is none. Never waits. Called after each uvcam_wait() until it gives
 * UVCAM_NONE, it yields every frame. `frame` becomes NULL where there is none, and is to be released where there is one.
 */
uvcam_status uvcam_receive(struct uvcam_subscriber *subscriber,
                           struct uvcam_frame **frame);

/**
 * Gives the newest unread frame, and drops those before it: they do not count as lost. Else as uvcam_receive().
 */
uvcam_status uvcam_receive_latest(struct uvcam_subscriber *subscriber,
                                  struct uvcam_frame **frame);

/**
 * Tells what a subscriber has counted.
 */
uvcam_status uvcam_get_counters(struct uvcam_subscriber *subscriber,
                                struct uvcam_counters *counters);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* UVCAM_H */
