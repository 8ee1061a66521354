"""Parts shared by all virtual robot controllers: control loop, motion, servo, elastic time, timers, calendar."""
