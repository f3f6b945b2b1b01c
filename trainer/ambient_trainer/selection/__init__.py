"""Which sensors and which circuit: searched by the error on blocks of time that no candidate was fitted to."""
