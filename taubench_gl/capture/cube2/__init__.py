"""Recordings (.dmo) and maps (.ogz) of Cube 2: Sauerbraten."""
