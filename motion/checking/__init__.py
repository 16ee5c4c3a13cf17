"""What can be wrong with captured motion, one kind of defect a file; `motion.check` puts them together."""
