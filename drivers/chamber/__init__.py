"""What all drivers of thermal chambers share: a dialect says how, these modules decide what."""
