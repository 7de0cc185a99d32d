/* What a bare Cortex-M needs to run a program: a vector table and a reset. No library of C. */
#include <stdint.h>

extern uint32_t stack_top, bss_start, bss_end;
int main(void);

/* The host of a simulator or a debugger: r0 is the operation, r1 its argument. */
static void host(uintptr_t operation, uintptr_t argument)
{
    register uintptr_t r0 __asm__("r0") = operation;
    register uintptr_t r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

void host_print(const char *text)
{
    host(0x04, (uintptr_t)text);
}

void reset(void)
{
    volatile uint32_t *const access = (uint32_t *)0xe000ed88; /* of coprocessors */
    uint32_t *word;
    *access |= 0xfu << 20; /* the floating-point unit */
    __asm__ volatile("dsb\n isb" ::: "memory");
    for (word = &bss_start; word < &bss_end; word++)
        *word = 0;
    host(0x18, main() == 0 ? 0x20026 : 0x20024); /* the end, well or not */
    for (;;) {
    }
}

static void fault(void)
{
    host_print("FAULT\n");
    host(0x18, 0x20024);
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static const uintptr_t vectors[] = {
    (uintptr_t)&stack_top, (uintptr_t)reset, (uintptr_t)fault, (uintptr_t)fault,
    (uintptr_t)fault,      (uintptr_t)fault, (uintptr_t)fault,
};
