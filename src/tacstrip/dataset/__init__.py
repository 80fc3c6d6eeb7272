"""Many scans: drawn, simulated and fitted in batches, written as data sets; studies of many designs."""
