"""Damaged input for every reader of foreign files, text and packets.

Inputs are well-formed ones of the corpus, damaged by Hypothesis (`tests/fuzz/test_damaged_inputs.py`) or by libFuzzer
(`guided`). A reader may accept an input or refuse it with an error of the project. Anything else is a fault: another
exception, too much processor time or memory, the end of the process. Linux only, because of /proc.
"""
