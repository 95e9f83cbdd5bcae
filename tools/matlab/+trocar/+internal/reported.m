function result = reported(bridge, event, flag)
    % What an event told last; false when there was none.
    result = false;
    try
        row = bridge.ask(struct('op', 'read', 'topic', event));
        result = logical(row.(flag));
    catch reason
        if ~strcmp(reason.identifier, 'trocar:refused')
            rethrow(reason);
        end
    end
end
