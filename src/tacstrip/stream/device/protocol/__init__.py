"""The wire format (docs/protocol.md): bytes to scans and messages and back."""
