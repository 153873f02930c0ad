"""Yokogawa GS200 (GS210, GS211) DC sources as current sources."""
