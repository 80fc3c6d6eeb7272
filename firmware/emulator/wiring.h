/* What hangs on the Uno's pins, as docs/guide/build.md wires it: multiplexers, weak pulls and the sensor's strips.

   A line is a capacitor that the selected strip charges through its resistance, and the pull through its own. */
#ifndef WIRING_H
#define WIRING_H

#include <stdbool.h>
#include <stdint.h>

#define MOST_STRIPS 64
#define LINES 2

struct wiring {
    int strips, ways, lines;
    double source_ohm, pull_ohm, node_farad, supply_volt;
    double volts[LINES][MOST_STRIPS]; /* at the sensor, NaN: nothing touches */
    double ohms[LINES][MOST_STRIPS];  /* between those volts and the line; 0: source_ohm */
    double sampled_volt;              /* what the converter's own capacitor has kept */
    double node_volt[LINES];
    double time_s;
    uint8_t port_b, port_d, direction_d;
    long clashes; /* times that two multiplexers of a line were enabled at once */
};

/* The converter's capacitor is joined to a line for a while, with what it had before; returns the volts it takes. */
double wiring_sample(struct wiring *w, int line, double seconds);

/* Let time pass for the lines; call it before anything changes and before a line is read. */
void wiring_advance(struct wiring *w, double time_s);

#endif
