/*
 * cmocka for our tests: include this instead of <cmocka.h>, in any order with our headers. cmocka
 * has a macro `fail` which would swallow ours (base/report.h); fail_msg() does the same and more.
 */
#ifndef SPBM_TEST_KIT_H
#define SPBM_TEST_KIT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#undef fail
#undef fail_msg
#define fail_msg(...) \
    do { \
        print_error("ERROR: " __VA_ARGS__); \
        print_error("\n"); \
        _fail(__FILE__, __LINE__); \
    } while (0)

#endif
