"""USD in and out: schema, reader, writer, validation."""
