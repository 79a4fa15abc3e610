"""Rule bases of others: files of MATLAB, Octave, fuzzylite and IEC 61131-7, read into tables and written."""
