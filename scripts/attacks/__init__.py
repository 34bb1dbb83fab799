"""What a campaign against the checker consists of: attacks on certificates, and a judge that shares no code with it."""
