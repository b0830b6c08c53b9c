"""What a run leaves in files: contact quantities, tables, fields, ledger of effects, summary."""
