/* SPDX-License-Identifier: Apache-2.0
 *
 * Lets User-Mode-Linux 6.1 run on processors with large register files. Preloaded, it stands
 * between linux.uml and ptrace().
 *
 * UML keeps room for the extended state of a process (x87, SSE, AVX) that ends before AMX. The
 * host's kernel refuses to set a state that is shorter than the processor's, so the first process
 * of the guest dies with "ptrace set fp regs failed, errno = 14". Here the whole state is read
 * from the process, UML's part is laid over it, and the whole is set. Only the AMX tiles are then
 * not kept apart between processes of the guest; nothing that runs in it uses them. Where UML's
 * room is large enough nothing is changed.
 */
#define _GNU_SOURCE
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static unsigned char whole[1 << 16] __attribute__((aligned(64)));

static long call(long request, pid_t pid, void *address, void *data)
{
    return syscall(SYS_ptrace, request, pid, address, data);
}

static long set_state(long request, pid_t pid, void *address, struct iovec *ours)
{
    struct iovec all = {whole, sizeof whole};

    if (call(PTRACE_GETREGSET, pid, address, &all) < 0)
        return -1;
    if (ours->iov_len >= all.iov_len)
        return call(request, pid, address, ours);
    memcpy(whole, ours->iov_base, ours->iov_len);
    return call(request, pid, address, &all);
}

long ptrace(enum __ptrace_request request, ...)
{
    va_list arguments;
    va_start(arguments, request);
    pid_t pid = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);

    switch ((int)request) {
    case PTRACE_SETREGSET:
        if ((long)address == NT_X86_XSTATE)
            return set_state(request, pid, address, data);
        break;
    case PTRACE_PEEKTEXT:
    case PTRACE_PEEKDATA:
    case PTRACE_PEEKUSER: {
        /* The system call stores the word; the C function returns it. */
        long word;
        return call(request, pid, address, &word) < 0 ? -1 : word;
    }
    }
    return call(request, pid, address, data);
}
