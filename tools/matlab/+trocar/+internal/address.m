function [host, port] = address(at)
    % HOST:PORT in its parts; the port is 7380 unless said.
    parts = regexp(at, '^(.*?)(?::(\d+))?$', 'tokens', 'once');
    host = parts{1};
    port = 7380;
    if numel(parts) > 1 && ~isempty(parts{2})
        port = str2double(parts{2});
    end
end
