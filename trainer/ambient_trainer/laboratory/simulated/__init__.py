"""Simulated instruments at the far ends of pseudo-terminals: the same bytes, errors and delays, and no hardware.

``SimulatedChamber(clock, *, folder=None, room_degC=22.0, dynamics=Chamber.shipped(), seed=0)``
    ``air_degC(at_s=None)`` is the true air, now or at a time of the clock since its start;
    ``raise_alarm(number, text)``, ``clear_alarm()``.
``SimulatedMultiplexer(clock, ambient, *, channels, folder=None, seed=0)``
    ``ambient`` is a callable from the clock's time to degC, or a mapping of such by channel; ``open_circuit(channel)``,
    ``mend(channel)``.
``SimulatedThermometer(clock, ambient, *, address=1, folder=None, auto_off_s=None, error_degC=0.0)``
    ``switch_off()``, ``switch_on()``, ``pull_sensor()``, ``push_sensor()``.

All of them have ``port`` (a link in ``folder`` to the pseudo-terminal), ``close()``, ``unplug()`` and ``plug()`` (the
link goes and comes back, to another terminal), ``mute()`` and ``unmute()`` (takes everything, says nothing), and
``twist(function)``: the next reply goes through ``function(reply) -> [(delay_s, bytes), ...]``.
"""
