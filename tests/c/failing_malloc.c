/* malloc and its kin, the k-th large request of which fails: for tests, by LD_PRELOAD (glibc). */
#include <errno.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdlib.h>

extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t),
    *__libc_memalign(size_t, size_t);

static size_t least;
static atomic_long left; /* 0: none fails any more */

/* From now on the k-th request of at least `bytes` fails, that one alone. */
void fail_request(size_t bytes, long k) {
    least = bytes;
    atomic_store(&left, k);
}

/* Whether one is still to fail. */
long requests_left(void) { return atomic_load(&left); }

static int fails(size_t bytes) {
    if (atomic_load(&left) <= 0 || bytes < least || atomic_fetch_sub(&left, 1) != 1) return 0;
    errno = ENOMEM;
    return 1;
}

void *malloc(size_t n) { return fails(n) ? NULL : __libc_malloc(n); }

void *calloc(size_t n, size_t size) {
    size_t all;
    if (__builtin_mul_overflow(n, size, &all)) return NULL;
    return fails(all) ? NULL : __libc_calloc(n, size);
}

void *realloc(void *old, size_t n) { return fails(n) ? NULL : __libc_realloc(old, n); }

void *aligned_alloc(size_t alignment, size_t n) {
    return fails(n) ? NULL : __libc_memalign(alignment, n);
}

int posix_memalign(void **at, size_t alignment, size_t n) {
    void *made = fails(n) ? NULL : __libc_memalign(alignment, n);
    if (made == NULL) return ENOMEM;
    *at = made;
    return 0;
}
