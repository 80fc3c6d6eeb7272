/* The compiled core: what every exported function takes. */

#ifndef TACSTRIP_CORE_H
#define TACSTRIP_CORE_H

#define TACSTRIP_VERSION 1 /* goes up whenever a function or a struct of this file changes */

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* TACSTRIP_VERSION; a loader refuses a library of another version. */
EXPORTED int tacstrip_core_version(void);

#endif
