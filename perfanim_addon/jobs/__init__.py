"""Jobs: long work in a worker process, shown in the sidebar."""
