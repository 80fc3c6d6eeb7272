"""The compiled core: C that is built when tacstrip is installed, and what finds it."""
