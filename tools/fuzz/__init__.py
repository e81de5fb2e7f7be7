"""Damaged input for every reader of foreign files, text and packets.

    cd tools && python -m fuzz --seconds 3600 --seed 1 --out ../out/fuzz

Each input is a well-formed one of the corpus, changed by rules of its grammar. It may be accepted, or refused with an
error of the project. All else is a fault: another exception, more than two seconds of the processor, no answer for
long, too much memory, the end of the process. Linux only: it looks at /proc.
"""
