// The page of `vfoa compare`: its tables.

import { fillTables } from "./tables.js";

fillTables();
document.documentElement.dataset.ready = "yes";
