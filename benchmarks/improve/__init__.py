"""Improve: are the tuned gains better on the true machine, and is what was promised true?"""
