"""The media between robots: radio and light. Pure: no I/O, no clock, no Zenoh, no asyncio."""
