"""Parts shared by the arms of all virtual controllers: control loop, motion, servo, elastic time, timers, calendar."""
