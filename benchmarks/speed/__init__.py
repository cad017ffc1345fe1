"""fpjax against a C++ loop and its peers: one servo loop, many candidates."""
