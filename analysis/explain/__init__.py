"""Why a run ended as it did: failures, what recovery made of them, the items' stories."""
