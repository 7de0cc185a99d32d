/* The series of tests/c/bits.c on a Cortex-M: lines `hash stack mean most name`. Instructions are
 * counted with SysTick where the simulator runs one instruction a nanosecond, 40 to a tick. */
#include "../../tests/c/bits.h"

enum { PATTERN = 0x5a5aa5a5, MARGIN = 64, INSTRUCTIONS = 40 };
extern uint32_t stack_end;
void host_print(const char *text);

static volatile uint32_t *const control = (uint32_t *)0xe000e010;
static volatile uint32_t *const reload = (uint32_t *)0xe000e014;
static volatile uint32_t *const counter = (uint32_t *)0xe000e018;
static uintptr_t top; /* of what was painted */

uint32_t bits_clock(void)
{
    static uint32_t last, total;
    const uint32_t now = *counter; /* counts down, 24 bits */
    total += ((last - now) & 0xffffffu) * INSTRUCTIONS;
    last = now;
    return total;
}

__attribute__((noinline)) void bits_paint(void)
{
    volatile uint32_t *word;
    top = (uintptr_t)__builtin_frame_address(0);
    for (word = &stack_end; (uintptr_t)word < top - MARGIN; word++)
        *word = PATTERN;
}

__attribute__((noinline)) uint32_t bits_depth(void)
{
    const volatile uint32_t *word = &stack_end;
    while ((uintptr_t)word < top - MARGIN && *word == PATTERN)
        word++;
    return (uint32_t)(top - (uintptr_t)word);
}

static void print_number(uint64_t value, unsigned base, int digits)
{
    char text[24];
    int k = 23;
    text[k] = 0;
    do {
        text[--k] = "0123456789abcdef"[value % base];
        value /= base;
    } while (value > 0 || 23 - k < digits);
    host_print(&text[k]);
    host_print(" ");
}

int main(void)
{
    bits_series series;
    int k, failures = 0;
    *reload = 0xffffff;
    *counter = 0;
    *control = 5; /* on, at the clock of the processor */
    for (k = 0; k < BITS_SERIES; k++) {
        failures += bits_run(k, &series) != 0;
        print_number(series.hash, 16, 16);
        print_number(series.stack, 10, 1);
        print_number(series.mean, 10, 1);
        print_number(series.most, 10, 1);
        host_print(series.name);
        host_print("\n");
    }
    return failures;
}
