"""report.html: one page a run or study, without external files, made of the files it left."""
