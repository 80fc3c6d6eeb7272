/* What a build fixes: the sensor, the line's speed, how touch is told. `make STRIPS=16 ...` sets it. */
#ifndef TACSTRIP_SETTINGS_H
#define TACSTRIP_SETTINGS_H

#define VERSION_MAJOR 1
#define VERSION_MINOR 1
#define VERSION_PATCH 0

#ifndef CONSTRUCTION
#define CONSTRUCTION "crs-crs"
#endif
#ifndef UNIT_NAME
#define UNIT_NAME "tacstrip"
#endif
#ifndef STRIPS
#define STRIPS 10
#endif

/* Signatures that are measured: 1 k_h, 2 k_l, 4 k; k_h and k are read on line 0, k_l on line 1. */
#ifndef SIGNATURES
#define SIGNATURES 3
#endif
#if SIGNATURES < 1 || SIGNATURES > 4
#error "SIGNATURES is 1 (k_h), 2 (k_l), 3 (both) or 4 (k)"
#endif
#define READINGS (SIGNATURES == 3 ? 2 : 1) /* codes per strip */

#ifndef BAUD
#define BAUD 500000UL
#endif
/* Time between the starts of two scans [us] until the host asks for another; 0: as fast as it goes. */
#ifndef PERIOD_US
#define PERIOD_US 10000UL
#endif

/* How long a line takes to follow its pull of 100 kohm far enough (twice 100 kohm x 100 pF), and then, released, to
   come back to the strip's voltage (ten times 10 kohm x 100 pF) [us]. */
#ifndef PULLED_US
#define PULLED_US 20
#endif
#ifndef RELEASED_US
#define RELEASED_US 10
#endif
/* A strip is touched where up and down pull its line apart by less than this part of Vref. A quarter with a pull of
   100 kohm: touched below 33 kohm from line to contact. */
#ifndef TOUCH_PART
#define TOUCH_PART 4
#endif

#endif
