#include "wiring.h"

#include <math.h>

#define ADDRESS_BIT 2 /* PD2-PD5 */
#define PULL_BIT 6    /* PD6, PD7 */
#define BANKS 4       /* PB0-PB3, active low */

/* The strip that the multiplexers connect, or -1. */
static int selected(struct wiring *w) {
    int found = -1, enabled = 0;
    for (int bank = 0; bank < BANKS; bank++) {
        if (w->port_b >> bank & 1) continue;
        enabled++;
        found = bank * w->ways + (w->port_d >> ADDRESS_BIT & (w->ways - 1));
    }
    w->clashes += enabled > 1;
    return found < w->strips ? found : -1;
}

void wiring_advance(struct wiring *w, double time_s) {
    int strip = selected(w);
    for (int line = 0; line < w->lines; line++) {
        double siemens = 0.0, amps = 0.0;
        if (strip >= 0 && !isnan(w->volts[line][strip])) {
            siemens += 1.0 / w->source_ohm;
            amps += w->volts[line][strip] / w->source_ohm;
        }
        if (w->direction_d >> (PULL_BIT + line) & 1) {
            siemens += 1.0 / w->pull_ohm;
            if (w->port_d >> (PULL_BIT + line) & 1) amps += w->supply_volt / w->pull_ohm;
        }
        if (siemens == 0.0) continue; /* an open line keeps its charge */
        double target = amps / siemens;
        double left = exp(-(time_s - w->time_s) * siemens / w->node_farad);
        w->node_volt[line] = target + (w->node_volt[line] - target) * left;
    }
    w->time_s = time_s;
}
