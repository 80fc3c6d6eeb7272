"""The wire format (docs/reference/protocol.md): bytes to scans and messages and back."""
