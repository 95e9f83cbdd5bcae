function bridge = connection(varargin)
    % The bridge that a class was given, or a new one to where it says: nothing, 'HOST:PORT', 'HOST:PORT', 'token'.
    if nargin == 0
        bridge = trocar.bridge('127.0.0.1:7380');
    elseif isa(varargin{1}, 'trocar.bridge')
        bridge = varargin{1};
    else
        bridge = trocar.bridge(varargin{:});
    end
end
