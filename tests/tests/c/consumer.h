/* What the consumers of the tests look at in each frame, beside what the library tells. */
#ifndef CONSUMER_H
#define CONSUMER_H

#include <inttypes.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <uvcam.h>

static volatile sig_atomic_t is_over;

static inline void end(int signal)
{
    (void)signal;
    is_over = 1;
}

/* Whether an image lies in memory that this process shares, and may not write. */
static inline bool is_shared(const uint8_t *pixels, size_t size)
{
    FILE *maps = fopen("/proc/self/maps", "r");
    char line[4096];
    bool found = false;
    while (maps != NULL && !found && fgets(line, sizeof line, maps) != NULL) {
        uintptr_t start, end;
        char rights[5];
        if (sscanf(line, "%" SCNxPTR "-%" SCNxPTR " %4s", &start, &end, rights) == 3)
            found = (uintptr_t)pixels >= start && (uintptr_t)pixels + size <= end && strcmp(rights, "r--s") == 0
                    && strstr(line, " /dev/shm/") != NULL;
    }
    if (maps != NULL)
        fclose(maps);
    return found;
}

/* Whether the lower 40 rows, which the mask of the test blanks, are black. */
static inline bool is_blanked(const uvcam_frame_header *header, const uint8_t *pixels)
{
    for (uint32_t y = header->height - 40; y < header->height; ++y)
        for (uint32_t x = 0; x < header->width; ++x)
            if (pixels[(size_t)y * header->stride + x] != 0)
                return false;
    return true;
}

static inline void tell(const uvcam_frame_header *header, const uint8_t *pixels, size_t size, uint64_t lost_before,
                        bool epoch_changed)
{
    printf("%" PRIu64 " %" PRIu64 " %" PRIu64 " %d %d %d\n", header->epoch, header->sequence, lost_before,
           epoch_changed, is_shared(pixels, size), is_blanked(header, pixels));
}

#endif
