/* Series of calls with hashes of the bits that they give: the same on every machine. The file that
 * includes this one says how a machine counts instructions and how deep its stack was used. */
#ifndef BITS_H
#define BITS_H

#include <stdint.h>

/* What a series gave. */
typedef struct {
    const char *name;
    uint64_t hash;
    uint32_t calls;
    uint32_t mean; /* instructions of a call */
    uint32_t most;
    uint32_t stack; /* bytes */
} bits_series;

enum { BITS_SERIES = 18, BITS_CALLS = 1500 };

/* Instructions since some moment; 0 where nobody counts. */
uint32_t bits_clock(void);
/* Fills the stack below the caller with a pattern. */
void bits_paint(void);
/* How far below the place that was painted last the stack was used (bytes). */
uint32_t bits_depth(void);

/* Runs the series with this number; 0 if all went well. */
int bits_run(int number, bits_series *series);

#endif
