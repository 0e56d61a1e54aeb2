"""Rules that the actuator enforces on every command, and that the controller checks too.

Read ``causes`` for modes and causes, ``state`` for the state, ``admission`` for which commands may
act, ``voltage`` and ``monitors`` for the limits, ``latch`` for trips and resets, ``freshness`` for
ages, and ``watchdog_feed`` for the hardware's own watchdog. All functions use only scalars and
small frozen records, no messages and no clock. Times passed as arguments are monotonic, in s.
"""
