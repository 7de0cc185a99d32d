/* The hashes on this machine, and the stack of a call: the series run on a stack of their own that was
 * filled with a pattern. Lines `hash bytes name`. */
#define _GNU_SOURCE
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include "bits.h"

enum { WORDS = 8192, PATTERN = 0x5a5aa5a5, MARGIN = 256 };
static uint32_t stack[WORDS] __attribute__((aligned(4096)));
static uintptr_t top; /* of what was painted */
static bits_series found[BITS_SERIES];
static int failures;

uint32_t bits_clock(void)
{
    return 0;
}

__attribute__((noinline)) void bits_paint(void)
{
    volatile uint32_t *word;
    /* this frame is as good as empty: what the caller calls next starts here too */
    top = (uintptr_t)__builtin_frame_address(0);
    for (word = stack; (uintptr_t)word < top - MARGIN; word++)
        *word = PATTERN;
}

__attribute__((noinline)) uint32_t bits_depth(void)
{
    const volatile uint32_t *word = stack;
    while ((uintptr_t)word < top - MARGIN && *word == PATTERN)
        word++;
    return (uint32_t)(top - (uintptr_t)word);
}

static void *all(void *unused)
{
    int k;
    for (k = 0; k < BITS_SERIES; k++)
        failures += bits_run(k, &found[k]) != 0;
    return unused;
}

int main(void)
{
    pthread_attr_t attributes;
    pthread_t thread;
    int k;
    memset(stack, 0, sizeof stack);
    pthread_attr_init(&attributes);
    if (pthread_attr_setstack(&attributes, stack, sizeof stack) != 0
        || pthread_create(&thread, &attributes, all, NULL) != 0)
        return 2;
    pthread_join(thread, NULL);
    for (k = 0; k < BITS_SERIES; k++)
        printf("%016llx %u %s\n", (unsigned long long)found[k].hash, (unsigned)found[k].stack,
               found[k].name);
    return failures != 0;
}
