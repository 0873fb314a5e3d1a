/* Assertions that say where they failed, and what the library said. */
#ifndef CHECK_H
#define CHECK_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <uvcam.h>

#define CHECK(condition)                                                                                       \
    do {                                                                                                       \
        if (!(condition)) {                                                                                    \
            fprintf(stderr, "%s:%d: not so: %s\nlast error: %s\n", __FILE__, __LINE__, #condition, uvcam_error_text()); \
            exit(1);                                                                                           \
        }                                                                                                      \
    } while (0)

/* A call that must fail with this status, and with a text that has these words. */
#define CHECK_FAILS(call, expected, words)                           \
    do {                                                             \
        CHECK((call) == (expected));                                 \
        CHECK(strstr(uvcam_error_text(), (words)) != NULL);          \
    } while (0)

#endif
