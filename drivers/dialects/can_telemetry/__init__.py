"""Units under test that send samples of their own output as CAN frames described by a DBC."""
