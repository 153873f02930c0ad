"""Common logic of all thermal chambers: these modules decide what to do, a dialect how."""
