/* The device as the host sees it: it says hello, obeys commands and sends scans. */
#ifndef TACSTRIP_DEVICE_H
#define TACSTRIP_DEVICE_H

void device_start(void);
void device_turn(void); /* one turn of the main loop */

#endif
