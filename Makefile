# Short names for the commands of dev.py.
COMMANDS := demo test lint bench docs build installer lock setup

.PHONY: $(COMMANDS)
$(COMMANDS):
	@python3 dev.py $@ $(ARGS)
