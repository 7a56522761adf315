"""Controllers, the plants on which they run, and the closed loop; a controller does not know which plant it acts on."""
