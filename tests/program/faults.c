/* Lets one call of a program fail, as a full disk or a busy machine does: loaded before the C library (LD_PRELOAD).
 * Calls of its libraries, such as a graphics driver, pass.
 *
 * FAULT_KIND: write, sync, rename, thread or alloc. FAULT_AT: the number of the call that fails, from 1; 0 for none.
 * FAULT_COUNT: a file into which the number of calls is written when the program ends. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <link.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

void *__libc_malloc(size_t);
void *__libc_calloc(size_t, size_t);
void *__libc_realloc(void *, size_t);
void *__libc_memalign(size_t, size_t);

enum kind { NONE, WRITE, SYNC, RENAME, THREAD, ALLOC };

static enum kind kind;
static long at;
static atomic_long calls;
/* Where the program's own code lies. */
static uintptr_t code, code_end;

/* The first object that is listed is the program. */
static int find_code(struct dl_phdr_info *object, size_t size, void *unused) {
    (void)size, (void)unused;
    for (int i = 0; i < object->dlpi_phnum; i++) {
        const ElfW(Phdr) *segment = &object->dlpi_phdr[i];
        if (segment->p_type != PT_LOAD || !(segment->p_flags & PF_X)) continue;
        code = object->dlpi_addr + segment->p_vaddr;
        code_end = code + segment->p_memsz;
    }
    return 1;
}

__attribute__((constructor)) static void begin(void) {
    static const char *const names[] = {"", "write", "sync", "rename", "thread", "alloc"};
    const char *name = getenv("FAULT_KIND"), *number = getenv("FAULT_AT");
    at = number ? atol(number) : 0;
    dl_iterate_phdr(find_code, NULL);
    for (int i = WRITE; name && i <= ALLOC; i++)
        if (!strcmp(name, names[i])) kind = i;
}

__attribute__((destructor)) static void end(void) {
    const char *path = getenv("FAULT_COUNT");
    long count = atomic_load(&calls);
    kind = NONE;
    FILE *file = path ? fopen(path, "w") : NULL;
    if (!file) return;
    fprintf(file, "%ld\n", count);
    fclose(file);
}

static int fails_from(void *caller, enum kind which, int error) {
    if (kind != which || (uintptr_t)caller - code >= code_end - code || atomic_fetch_add(&calls, 1) + 1 != at) return 0;
    errno = error;
    return 1;
}

#define fails(which, error) fails_from(__builtin_return_address(0), which, error)

ssize_t write(int fd, const void *bytes, size_t count) {
    return fails(WRITE, ENOSPC) ? -1 : syscall(SYS_write, fd, bytes, count);
}

ssize_t writev(int fd, const struct iovec *parts, int count) {
    return fails(WRITE, ENOSPC) ? -1 : syscall(SYS_writev, fd, parts, count);
}

ssize_t pwrite64(int fd, const void *bytes, size_t count, off64_t offset) {
    return fails(WRITE, ENOSPC) ? -1 : syscall(SYS_pwrite64, fd, bytes, count, offset);
}

int fsync(int fd) { return fails(SYNC, EIO) ? -1 : syscall(SYS_fsync, fd); }

int fdatasync(int fd) { return fails(SYNC, EIO) ? -1 : syscall(SYS_fdatasync, fd); }

int rename(const char *from, const char *to) { return fails(RENAME, EIO) ? -1 : syscall(SYS_renameat2, -100, from, -100, to, 0); }

int renameat2(int from_fd, const char *from, int to_fd, const char *to, unsigned flags) {
    return fails(RENAME, EIO) ? -1 : syscall(SYS_renameat2, from_fd, from, to_fd, to, flags);
}

int renameat(int from_fd, const char *from, int to_fd, const char *to) {
    return fails(RENAME, EIO) ? -1 : syscall(SYS_renameat2, from_fd, from, to_fd, to, 0);
}

int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*run)(void *), void *with) {
    static int (*real)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
    if (fails(THREAD, EAGAIN)) return EAGAIN;
    if (!real) real = dlsym(RTLD_NEXT, "pthread_create");
    return real(thread, attributes, run, with);
}

void *malloc(size_t size) { return fails(ALLOC, ENOMEM) ? NULL : __libc_malloc(size); }

void *calloc(size_t count, size_t size) { return fails(ALLOC, ENOMEM) ? NULL : __libc_calloc(count, size); }

void *realloc(void *memory, size_t size) { return fails(ALLOC, ENOMEM) ? NULL : __libc_realloc(memory, size); }

int posix_memalign(void **memory, size_t alignment, size_t size) {
    if (fails(ALLOC, ENOMEM) || !(*memory = __libc_memalign(alignment, size))) return ENOMEM;
    return 0;
}
