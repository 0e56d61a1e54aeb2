/* Preloaded into a program, it gives the files below a folder no locks, as some network shares do. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static int refused(int descriptor) {
    const char *folder = getenv("NO_LOCKS_BELOW"), *number = getenv("NO_LOCKS_ERRNO");
    char link[64], place[4096];
    ssize_t length;
    if (!folder || !number) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
    length = readlink(link, place, sizeof place - 1);
    if (length < 0) return 0;
    place[length] = 0;
    if (strncmp(place, folder, strlen(folder))) return 0;
    errno = atoi(number);
    return 1;
}

int flock(int descriptor, int operation) {
    int (*next)(int, int) = dlsym(RTLD_NEXT, "flock");
    return refused(descriptor) ? -1 : next(descriptor, operation);
}

static int locks(int command) {
    return command == F_SETLK || command == F_SETLKW || command == F_GETLK
        || command == F_OFD_SETLK || command == F_OFD_SETLKW || command == F_OFD_GETLK;
}

int fcntl(int descriptor, int command, ...) {
    int (*next)(int, int, ...) = dlsym(RTLD_NEXT, "fcntl");
    va_list rest;
    void *argument;
    va_start(rest, command);
    argument = va_arg(rest, void *);
    va_end(rest);
    return locks(command) && refused(descriptor) ? -1 : next(descriptor, command, argument);
}

int fcntl64(int descriptor, int command, ...) {
    int (*next)(int, int, ...) = dlsym(RTLD_NEXT, "fcntl64");
    va_list rest;
    void *argument;
    va_start(rest, command);
    argument = va_arg(rest, void *);
    va_end(rest);
    return locks(command) && refused(descriptor) ? -1 : next(descriptor, command, argument);
}
