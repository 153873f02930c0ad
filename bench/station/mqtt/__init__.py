"""MQTT: what is seen of a station, published to a broker by a process of its own.

A broker can slow or end that process only. Topics and payloads are in docs/reference/mqtt.md.
"""
