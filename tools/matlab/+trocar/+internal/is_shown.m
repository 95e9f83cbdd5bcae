function result = is_shown(bridge, name)
    % Whether an instance shows fresh records, and the bridge is there.
    result = true;
    try
        bridge.read([name '/state']);
    catch reason
        result = false;
        if ~strncmp(reason.identifier, 'trocar:', 7)
            rethrow(reason);
        end
    end
end
