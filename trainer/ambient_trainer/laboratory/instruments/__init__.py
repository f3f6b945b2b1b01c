"""The instruments on their serial lines: what may be asked of them, and how they fail.

``Chamber(port, low_degC=-20.0, high_degC=60.0, *, name="chamber", clock=RealClock(), pause_s=0.0, timeout_s=2.0)``
    ``identify() -> str``, ``read() -> ChamberReading``, ``set_point(temp_degC)`` (starts it, too),
    ``gradient(up_K_min, down_K_min)``, ``stop()``, ``acknowledge()``. A set point outside ``low_degC`` to
    ``high_degC``, or outside the chamber's own -45 to 185 degC, is :class:`~ambient_model.faults.Refused` before a
    byte is sent. ``pause_s`` lies between two questions; a later controller takes one in 5 s.
``Multiplexer(port, probes, offsets=None, *, thermocouple="K", name="multiplexer", clock, baud=57600, timeout_s=5.0)``
    ``probes`` maps a name to its channel (``{"air1": 101}``), ``offsets`` a name to its
    :class:`~ambient_trainer.laboratory.instruments.offsets.ProbeOffset` (``load_offsets(path)`` reads what
    ``calibrate`` wrote). ``identify() -> str``, ``configure()``, ``read() -> MultiplexerReading``; ``read`` configures
    by itself where nobody did since the line was lost.
``Thermometer(port, *, address=1, name="thermometer", clock, timeout_s=1.0)``
    ``identify() -> str``, ``read() -> ThermometerReading``.

All of them have ``name``, ``port`` and ``close()``. None opens its port before it is first asked, and each opens it
again after it was lost: whoever asks again and again needs to do nothing else. They may be asked by several threads,
one exchange at a time; an exchange lasts no longer than its timeout, its pause, and as much again where the line has to
be brought in step.

What goes wrong is a :class:`~ambient_trainer.laboratory.line.LineError`, which names instrument, port, what was
expected and what came: ``Unplugged`` (the port is gone or cannot be opened), ``Silent`` (nothing came in time;
``SwitchedOff`` is a thermometer's), and plain ``LineError`` for what is no answer to the question, or only a part of
one. After any of them the same instrument may simply be asked again.
"""
