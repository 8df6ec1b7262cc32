"""Robot cell in MuJoCo, served over picktree's protocol of drivers by a process of its own.

It imports `picktree.drivers.protocol` and nothing else of picktree: what the two have in common is the
protocol and a cell file.
"""
