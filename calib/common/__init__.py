"""Common: helpers that know nothing of robots: files, scales, checks, threads, words."""
