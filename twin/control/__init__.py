"""Controllers, each an object that neither knows nor sees which plant it acts on."""
