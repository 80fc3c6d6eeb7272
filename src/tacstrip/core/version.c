#include "core.h"

int tacstrip_core_version(void) { return TACSTRIP_VERSION; }
