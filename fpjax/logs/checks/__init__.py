"""What `fpjax inspect` and the verbs say about a log: its contents, and where its units, signs or clock look wrong."""
