#include "wiring.h"

#include <math.h>

#define ADDRESS_BIT 2 /* PD2-PD5 */
#define PULL_BIT 6    /* PD6, PD7 */
#define BANKS 4       /* PB0-PB3, active low */
#define SAMPLER_FARAD 14e-12

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

/* Charge a line of so many farad for a while, from so many volt. */
static double charged(struct wiring *w, int line, double volt, double farad, double seconds) {
    int strip = selected(w);
    double siemens = 0.0, amps = 0.0;
    if (strip >= 0 && !isnan(w->volts[line][strip])) {
        double ohm = w->ohms[line][strip] > 0.0 ? w->ohms[line][strip] : w->source_ohm;
        siemens += 1.0 / ohm;
        amps += w->volts[line][strip] / ohm;
    }
    if (w->direction_d >> (PULL_BIT + line) & 1) {
        siemens += 1.0 / w->pull_ohm;
        if (w->port_d >> (PULL_BIT + line) & 1) amps += w->supply_volt / w->pull_ohm;
    }
    if (siemens == 0.0) return volt; /* an open line keeps its charge */
    double target = amps / siemens;
    return target + (volt - target) * exp(-seconds * siemens / farad);
}

void wiring_advance(struct wiring *w, double time_s) {
    for (int line = 0; line < w->lines; line++)
        w->node_volt[line] = charged(w, line, w->node_volt[line], w->node_farad, time_s - w->time_s);
    w->time_s = time_s;
}

double wiring_sample(struct wiring *w, int line, double seconds) {
    double both = w->node_farad + SAMPLER_FARAD;
    double volt = (w->node_farad * w->node_volt[line] + SAMPLER_FARAD * w->sampled_volt) / both;
    w->sampled_volt = charged(w, line, volt, both, seconds);
    w->node_volt[line] = w->sampled_volt;
    return w->sampled_volt;
}
